//! A gateway in a world: its statics, its tasks, and the settings that a test gives as lines.

use std::net::{IpAddr, Ipv4Addr};

use embassy_time::Duration;
use mobgate::config::{Loader, PORTS_MAX, Port, PortId, PortKind, Settings};
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::{Gateway, PortPlace, Seat};
use mobgate::stats::Event;

use crate::wire::EndRecord;
use crate::{Client, Device, LineEnd, Network, SimSerial, Wire, World, device};

/// Frames of the rig's gateway beyond the one that each seat has of its own.
pub const SHARED_FRAMES: usize = 32;
/// Connections of the rig's gateway, over all its TCP servers.
pub const SEATS: usize = 80;

/// When a test begins: by then the ports are open.
const STARTED: Duration = Duration::from_millis(10);

/// A running gateway and its surroundings.
pub struct Rig<'w> {
    /// The gateway; its tasks run in the world.
    pub gateway: &'w Gateway<'w>,
    /// The network that its TCP servers listen at.
    pub network: Network,
    lines: Vec<Line>,
}

/// A serial line of the rig: the wire and the gateway's end of it.
struct Line {
    device: String,
    wire: Wire,
    end: LineEnd,
}

/// Runs `test` in a world of `seed` with a gateway that was given `settings`, lines of the console's language. Every serial
/// device that they name is a wire, on which the test may put devices.
///
/// # Panics
/// When the settings are refused.
pub fn run<R>(seed: u64, settings: &str, test: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>) -> R) -> R {
    let slots: Vec<Slot> = (0..SEATS + SHARED_FRAMES).map(|_| Slot::new()).collect();
    let pool = FramePool::new(&slots, SEATS);
    let places: Vec<PortPlace> = (0..PORTS_MAX).map(|_| PortPlace::new()).collect();
    let seats: Vec<Seat> = (0..SEATS).map(|_| Seat::new()).collect();
    let gateway = Gateway::new(&pool, &places, &seats);
    let settings = parse(settings);
    gateway.apply(&settings).expect("settings that fit the rig");

    let mut world = World::new(seed);
    let network = Network::new(seed);
    let lines: Vec<Line> = settings.ports.iter().flatten().filter_map(Line::of).collect();
    let host = lines.iter().fold(SimSerial::new(), |host, line| host.with(&line.device, &line.end));
    world.spawn(gateway.route());
    for port in 0..PORTS_MAX {
        let mut host = host.clone();
        let gateway = &gateway;
        world.spawn(async move { gateway.run_port(PortId(port as u8), &mut host).await });
    }
    for seat in 0..SEATS {
        let mut host = network.host();
        let gateway = &gateway;
        world.spawn(async move { gateway.run_seat(seat, &mut host).await });
    }
    let rig = Rig { gateway: &gateway, network, lines };
    world.run_for(STARTED);
    test(&mut world, &rig)
}

/// Settings from their lines.
///
/// # Panics
/// When a line is bad.
pub fn parse(lines: &str) -> Settings {
    let mut settings = Settings::new();
    let mut loader = Loader::new(&mut settings);
    loader.feed(lines.as_bytes()).and_then(|()| loader.finish()).unwrap_or_else(|error| panic!("{error}"));
    settings
}

impl Line {
    fn of(port: &Port) -> Option<Self> {
        let PortKind::Serial(serial) = &port.kind else { return None };
        let wire = Wire::new();
        let end = wire.tap(serial.line);
        Some(Self { device: serial.device.as_str().to_owned(), wire, end })
    }
}

impl<'w> Rig<'w> {
    fn line(&self, device: &str) -> &Line {
        self.lines.iter().find(|line| line.device == device).expect("a device of the settings")
    }

    /// The wire behind the serial device called `device`.
    ///
    /// # Panics
    /// When no port names it.
    pub fn wire(&self, device: &str) -> &Wire {
        &self.line(device).wire
    }

    /// What the gateway has sent on the wire behind `device`.
    ///
    /// # Panics
    /// When no port names it.
    pub fn sent(&self, device: &str) -> EndRecord {
        let line = self.line(device);
        line.wire.record_of(&line.end)
    }

    /// Puts `devices` on the wire behind `device`, at one connection to it, with the gateway's speed and format.
    ///
    /// # Panics
    /// When no port names it.
    pub fn attach(&self, world: &World<'w>, device: &str, devices: &[Device]) {
        let line = self.line(device);
        let end = line.wire.tap(line.end.line());
        world.spawn(device::serve(end, devices.to_vec()));
    }

    /// A client of the machine 10.0.0.`host`, connected to TCP `port`.
    ///
    /// # Panics
    /// When nobody listens there.
    pub fn client(&self, host: u8, port: u16) -> Client {
        Client::new(self.network.connect(address(host), port).expect("a listener"))
    }

    /// How often the port called `name` counted `event`.
    ///
    /// # Panics
    /// When there is no such port.
    pub fn count(&self, name: &str, event: Event) -> u32 {
        let id = self.gateway.settings(|settings| settings.find(name)).expect("a port of the settings");
        self.gateway.ports()[id.index()].stats.get(event)
    }

    /// Frames that are somewhere on their way.
    pub fn frames_in_use(&self) -> usize {
        self.gateway.pool().capacity() - self.gateway.pool().free()
    }
}

/// The machine 10.0.0.`host`.
pub fn address(host: u8) -> IpAddr {
    IpAddr::V4(Ipv4Addr::new(10, 0, 0, host))
}
