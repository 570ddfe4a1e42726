//! Plays a case: builds its world, takes its steps, and at the end checks what holds in every case.

use std::collections::BTreeMap;
use std::net::SocketAddr;

use embassy_time::{Duration, Instant, Timer};
use mobgate::language::apply;
use mobgate::settings::{LineSettings, PortKind, Settings};
use mobgate_simulator::device::tcp::Stream;
use mobgate_simulator::net::{self, Path};
use mobgate_simulator::{Device, LineEnd, Rig, World, device, rig, wire::Silence};

mod acts;
mod clients;
mod points;

use crate::faults::faults;
use crate::file::{self, Bus, Case, Server};
use crate::script::sentences;
use crate::words::duration;
use clients::Clients;

/// After the last step the clients leave, and so long later nothing may be left of their requests.
const AFTERMATH: Duration = Duration::from_secs(60);

/// What the steps act on.
struct Stage<'s, 'r, 'g> {
    rig: &'r Rig<'g>,
    /// By bus and unit id.
    devices: BTreeMap<(String, u8), Device>,
    servers: &'s BTreeMap<SocketAddr, Server>,
    /// Those that accept nobody.
    deaf: Vec<net::Server>,
    /// A tap on each wire, for noise.
    strangers: BTreeMap<String, LineEnd>,
    clients: Clients<'s>,
    /// When the first step was taken.
    begun: Instant,
}

/// Every case is played with this many seeds: they decide in which order tasks that could run do run.
const SEEDS: u64 = 3;

/// Plays `case`; what is not as it should be is told with the step at which it showed.
pub(crate) fn play(case: &Case) -> Result<(), String> {
    (1..=SEEDS).try_for_each(|seed| play_once(case, seed).map_err(|error| format!("{error} (seed {seed})")))
}

fn play_once(case: &Case, seed: u64) -> Result<(), String> {
    rig::with_gateway(seed, &case.settings, |world, rig| {
        let mut stage = Stage::build(case, world, rig)?;
        for (line, sentence) in sentences(&case.steps) {
            let acted = stage.act(world, &sentence);
            acted.map_err(|error| format!("at `{line}`: {error}, at {} us", Instant::now().as_micros()))?;
        }
        stage.clients.check_nothing_is_left()?;
        stage.clients.leave();
        stage.stop_polling();
        world.run_for(AFTERMATH);
        stage.check_gateway()
    })
}

impl<'s, 'r, 'g> Stage<'s, 'r, 'g> {
    fn build(case: &'s Case, world: &World<'_>, rig: &'r Rig<'g>) -> Result<Self, String> {
        let mut stage = Self {
            rig,
            devices: BTreeMap::new(),
            servers: &case.server,
            deaf: Vec::new(),
            strangers: BTreeMap::new(),
            clients: Clients::new(&case.client),
            begun: Instant::now(),
        };
        for (name, bus) in &case.bus {
            stage.connect_bus(world, name, bus)?;
        }
        for (address, _) in case.server.iter().filter(|(_, server)| !server.absent) {
            stage.listen(world, *address)?;
        }
        Ok(stage)
    }

    /// The server at `address` listens from now on.
    fn listen(&mut self, world: &World<'_>, address: SocketAddr) -> Result<(), String> {
        let server = self.servers.get(&address).ok_or("there is no such server")?;
        let framing = if server.rtu { Stream::Rtu } else { Stream::Mbap };
        let mut devices = Vec::new();
        for (seed, setup) in server.device.iter().enumerate() {
            let device = new_device(setup, seed)?;
            self.devices.insert((address.to_string(), setup.unit), device.clone());
            devices.push(device);
        }
        if let Some(name) = &server.name {
            self.rig.network.set_name(name, Some(address.ip()));
        }
        if let Some(latency) = &server.latency {
            self.rig.network.set_path(address, Path { latency: duration(latency)?, ..Path::default() });
        }
        let listener = self.rig.network.serve(address);
        if server.deaf {
            self.deaf.push(listener);
        } else if let Some(time) = &server.closes_after {
            world.spawn(close_each(listener, duration(time)?));
        } else {
            world.spawn(device::tcp::serve(listener, framing, devices, world.spawner()));
        }
        Ok(())
    }

    fn connect_bus(&mut self, world: &World<'_>, name: &str, bus: &Bus) -> Result<(), String> {
        let end = self.rig.end(name);
        end.set_echo(bus.echo);
        let line_of = |own: &Option<String>, other| own.as_deref().map_or(Ok(other), line_settings);
        let line = line_of(&bus.line, end.line())?;
        let wire = self.rig.wire(name);
        self.strangers.insert(name.to_owned(), wire.tap(line));
        let mut together = Vec::new();
        for (seed, setup) in bus.device.iter().enumerate() {
            let device = new_device(setup, seed)?;
            self.devices.insert((name.to_owned(), setup.unit), device.clone());
            if setup.apart || setup.line.is_some() {
                let line = line_of(&setup.line, line)?;
                world.spawn(device::serve_in(self.rig.framing(name), wire.tap(line), vec![device]));
            } else {
                together.push(device);
            }
        }
        world.spawn(device::serve_in(self.rig.framing(name), wire.tap(line), together));
        Ok(())
    }

    /// The scanner would have frames on their way for ever.
    fn stop_polling(&self) {
        let mut settings = self.rig.gateway.settings(Settings::clone);
        settings.points.clear();
        settings.devices.clear();
        self.rig.gateway.apply(&settings).expect("fewer settings than before");
    }

    /// What holds after every case: no frame is lost, and the gateway kept its silences.
    fn check_gateway(&self) -> Result<(), String> {
        let pool = self.rig.gateway.pool();
        if pool.free() != pool.capacity() {
            return Err(format!("{} frames have not come home", pool.capacity() - pool.free()));
        }
        for device in self.rig.devices() {
            let end = self.rig.end(device);
            let least = end.line().gap.map_or(Silence::of(&end.line()).between_ns, |gap| gap.as_nanos());
            match self.rig.wire(device).record_of(end).shortest_gap_ns {
                Some(gap) if gap < least => {
                    return Err(format!("a gap of {gap} ns on {device} is shorter than {least} ns"));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// Accepts connections, and closes each after `time`.
async fn close_each(listener: net::Server, time: Duration) {
    loop {
        let stream = listener.accept().await;
        Timer::after(time).await;
        drop(stream);
    }
}

/// Speed and format from words of the settings language.
fn line_settings(words: &str) -> Result<LineSettings, String> {
    let mut settings = Settings::new();
    let line = format!("port any serial any ascii client {words}");
    apply(&mut settings, &line).map_err(|error| error.to_string())?;
    match settings.ports.iter().flatten().next().map(|port| &port.kind) {
        Some(PortKind::Serial(serial)) => Ok(serial.line),
        _ => Err(format!("{words} is no line")),
    }
}

fn new_device(setup: &file::Device, seed: usize) -> Result<Device, String> {
    let mut device = Device::new(setup.unit).with_notes().with_faults(faults(seed as u64, &setup.faults)?);
    if let Some(turnaround) = &setup.turnaround {
        device = device.with_turnaround(duration(turnaround)?);
    }
    if let Some(rest) = &setup.rest {
        device = device.with_rest(duration(rest)?);
    }
    if let Some(address) = setup.fresh {
        device = device.with_fresh(address);
    }
    if let Some(address) = setup.missing {
        device = device.with_missing(address);
    }
    if let Some(after) = &setup.watchdog {
        device = device.with_watchdog(duration(after)?);
    }
    Ok(device)
}
