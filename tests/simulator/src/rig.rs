//! A gateway in a world: its settings are lines of text, its serial devices are wires, its clients come over a network.
//!
//! Every serial device that the settings name is a wire of its own with the gateway on it, unless the names of two differ only
//! behind an `@`: then both are on one wire, as two gateways would be. What else is on the wire the
//! scenario adds. All of it lives on the stack of [`with_gateway`], and ends with it.
//!
//! Settings that are not good panic, and so does the name of a device or port that they do not have.

use std::net::{IpAddr, Ipv4Addr};

use embassy_time::Duration;
use mobgate::capture::Capture;
use mobgate::fieldbus::EthercatState;
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::audit::AuditMemory;
use mobgate::gateway::{Candidate, Connection, Gateway, Ports};
use mobgate::language::{LineBuffer, Loader, apply};
use mobgate::scanner::ScannerState;
use mobgate::settings::{Framing, PORTS_MAX, PortId, PortKind, SerialSettings, Settings, Side};
use mobgate::stats::Event;

use crate::client::{Client, Response};
use crate::device::tcp::{Stream, converse, serve as serve_tcp};
use crate::device::{Device, serve_in};
use crate::master::Master;
use crate::net::{ClientStream, Network};
use crate::serial::SimSerial;
use crate::wire::{EndRecord, LineEnd, Wire};
use crate::world::{Clock, World};

/// What board the gateway runs on.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    /// Frames in the pool; a connection and a port have one of them each for themselves.
    pub frames: usize,
    /// TCP connections at a time.
    pub connections: usize,
    /// How late what is heard on serial lines may be read: not before the next multiple of this time.
    pub late_reads: Duration,
    /// How late it reads at most because it leaves its lines alone while characters gather.
    pub rests: Duration,
    /// Whether its interrupts count characters, so that it reads those that it needs together.
    pub gathers: bool,
    /// How long it takes to open a serial line.
    pub opening: Duration,
    /// Makes its EtherCAT side.
    pub ethercat: fn() -> EthercatState,
    /// Whether that is at a network interface of the settings, as on Linux.
    pub ethercat_interfaces: bool,
    /// Whether its settings have the network's, as on a board.
    pub owns_network: bool,
}

impl Default for Size {
    /// 80 connections, 128 frames, every character read as it comes, lines opened at once, images of 512 bytes.
    fn default() -> Self {
        let [late_reads, rests, opening] = [Duration::from_ticks(0); 3];
        let ethercat = EthercatState::new;
        let [gathers, ethercat_interfaces, owns_network] = [false; 3];
        Self {
            frames: 128,
            connections: 80,
            late_reads,
            rests,
            gathers,
            opening,
            ethercat,
            ethercat_interfaces,
            owns_network,
        }
    }
}

/// The gateway and what it is connected to.
pub struct Rig<'g> {
    /// The gateway itself.
    pub gateway: &'g Gateway<'g>,
    /// The network that its TCP ports are on.
    pub network: Network,
    lines: Vec<Line>,
}

/// A serial device of the gateway.
struct Line {
    device: String,
    framing: Framing,
    wire: Wire,
    end: LineEnd,
}

/// Runs `scenario` with a gateway of the usual size that has `settings`.
pub fn with_gateway<T>(
    seed: u64,
    settings: &str,
    scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>) -> T,
) -> T {
    with_gateway_of(Size::default(), seed, settings, scenario)
}

/// Runs `scenario` with a gateway of `size` that has `settings`. The gateway has been started and its listeners are open.
pub fn with_gateway_of<T>(
    size: Size,
    seed: u64,
    settings: &str,
    scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>) -> T,
) -> T {
    with_gateway_on(Clock::Virtual, size, seed, settings, scenario)
}

/// Runs `scenario` with such a gateway in a world with this `clock`.
pub fn with_gateway_on<T>(
    clock: Clock,
    size: Size,
    seed: u64,
    settings: &str,
    scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>) -> T,
) -> T {
    let settings = settings_of(settings);
    let lines = lines(&settings);
    let slots: Vec<Slot> = (0..size.frames).map(|_| Slot::new()).collect();
    let places = Ports::<PORTS_MAX>::new();
    let connections: Vec<Connection> = (0..size.connections).map(|_| Connection::new()).collect();
    let pool = FramePool::new(&slots, size.connections + PORTS_MAX);
    let scanner = ScannerState::new();
    let capture = Capture::new();
    let ethercat = (size.ethercat)();
    let (candidate, audit) = (Candidate::new(), AuditMemory::new());
    // In a frame of its own, whose moves of the large value do not stay on the stack of the scenario.
    let build = || {
        let gateway = Gateway::new(&pool, &places, &connections).with_candidate(&candidate);
        let gateway = gateway.with_audit(&audit);
        let gateway = gateway.with_scanner(&scanner).with_capture(&capture);
        let gateway = match size.ethercat_interfaces {
            true => gateway.with_ethercat_interfaces(&ethercat),
            false => gateway.with_ethercat(&ethercat),
        };
        Box::new(if size.owns_network { gateway.with_own_network() } else { gateway })
    };
    let gateway = build();
    let mut world = World::on(clock, seed);
    let rig = Rig { gateway: &gateway, network: Network::new(seed), lines };
    rig.gateway.apply(&settings).expect("settings that the gateway takes");
    rig.start(&world, size);
    world.run_for(discarding(&settings) + Duration::from_ticks(1));
    scenario(&mut world, &rig)
}

/// How long the clients on serial lines discard what they hear after the start, and send nothing.
fn discarding(settings: &Settings) -> Duration {
    let ports = settings.ports.iter().flatten();
    let windows = ports.filter_map(|port| match &port.kind {
        PortKind::Serial(serial) if serial.side == Side::Client => Some(serial.client.late_window()),
        _ => None,
    });
    windows.max().unwrap_or(Duration::from_ticks(0))
}

/// The settings that these lines make.
pub fn settings_of(lines: &str) -> Settings {
    let mut settings = Settings::new();
    let mut line = LineBuffer::default();
    let mut loader = Loader::new(&mut settings, &mut line);
    loader.feed(lines.as_bytes()).and_then(|()| loader.finish()).unwrap_or_else(|error| panic!("{error}"));
    settings
}

fn serial(kind: &PortKind) -> Option<&SerialSettings> {
    match kind {
        PortKind::Serial(serial) => Some(serial),
        _ => None,
    }
}

fn lines(settings: &Settings) -> Vec<Line> {
    let mut lines: Vec<Line> = Vec::new();
    for serial in settings.ports.iter().flatten().filter_map(|port| serial(&port.kind)) {
        let device = serial.device.as_str().to_owned();
        let shared = lines.iter().find(|line| wire_of(&line.device) == wire_of(&device));
        let wire = shared.map_or_else(Wire::new, |line| line.wire.clone());
        let end = wire.tap(serial.line);
        lines.push(Line { device, framing: serial.framing, wire, end });
    }
    lines
}

/// The wire of a device: `bus@left` and `bus@right` are two devices of the gateway on the wire `bus`.
fn wire_of(device: &str) -> &str {
    device.split_once('@').map_or(device, |(wire, _)| wire)
}

impl<'g> Rig<'g> {
    fn start(&self, world: &World<'g>, size: Size) {
        let gateway = self.gateway;
        world.spawn(gateway.route());
        let Size { late_reads, rests, gathers, opening, .. } = size;
        let devices = self.lines.iter().map(|line| (line.device.clone(), line.end.clone())).collect();
        let board = SimSerial { devices, late_reads, rests, gathers, opening };
        for port in 0..PORTS_MAX {
            let mut host = board.clone();
            let (connector, mut datagrams) = (self.network.connector(), self.network.udp_host());
            world.spawn(async move {
                gateway.run_port(PortId(port as u8), &mut host, &connector, &mut datagrams).await
            });
        }
        for connection in 0..size.connections {
            let mut host = self.network.host();
            world.spawn(async move { gateway.run_connection(connection, &mut host).await });
        }
    }

    /// The wire that the gateway knows as `device`.
    pub fn wire(&self, device: &str) -> &Wire {
        &self.line(device).wire
    }

    /// The gateway's own connection to the wire `device`.
    pub fn end(&self, device: &str) -> &LineEnd {
        &self.line(device).end
    }

    fn line(&self, device: &str) -> &Line {
        let line = self.lines.iter().find(|line| line.device == device);
        line.unwrap_or_else(|| panic!("no serial device is called {device}"))
    }

    /// Puts `devices` on the wire `device`, at one connection to it, with the gateway's speed, format and framing.
    pub fn attach(&self, world: &World<'g>, device: &str, devices: impl Into<Vec<Device>>) {
        let Line { wire, end, framing, .. } = self.line(device);
        world.spawn(serve_in(*framing, wire.tap(end.line()), devices.into()));
    }

    /// A master on the wire `device`, with the gateway's speed, format and framing.
    pub fn master(&self, device: &str) -> Master {
        let Line { wire, end, framing, .. } = self.line(device);
        Master::new(wire.tap(end.line()), *framing)
    }

    /// The framing of the wire `device`.
    pub fn framing(&self, device: &str) -> Framing {
        self.line(device).framing
    }

    /// Puts `devices` into the network, behind Modbus TCP at `address`.
    pub fn attach_tcp(&self, world: &World<'g>, address: &str, devices: impl Into<Vec<Device>>) {
        self.attach_at(world, address, false, devices);
    }

    /// Puts `devices` into the network at `address`, behind RTU over TCP or behind Modbus TCP.
    pub fn attach_at(&self, world: &World<'g>, address: &str, is_rtu: bool, devices: impl Into<Vec<Device>>) {
        let stream = if is_rtu { Stream::Rtu } else { Stream::Mbap };
        let address = address.parse().expect("an address such as 10.0.1.1:502");
        world.spawn(serve_tcp(self.network.serve(address), stream, devices.into(), world.spawner()));
    }

    /// Puts `devices` into the network, behind RTU over TCP at `address`.
    pub fn attach_rtu_over_tcp(&self, world: &World<'g>, address: &str, devices: impl Into<Vec<Device>>) {
        self.attach_at(world, address, true, devices);
    }

    /// Has `devices` serve the gateway on a connection that they have made to it.
    pub fn serve_on(
        &self,
        world: &World<'g>,
        stream: ClientStream,
        is_rtu: bool,
        devices: impl Into<Vec<Device>>,
    ) {
        let framing = if is_rtu { Stream::Rtu } else { Stream::Mbap };
        world.spawn(converse(stream, framing, devices.into()));
    }

    /// What the gateway has sent on the wire `device`.
    pub fn sent(&self, device: &str) -> EndRecord {
        let Line { wire, end, .. } = self.line(device);
        wire.record_of(end)
    }

    /// Frames that are somewhere on their way.
    pub fn frames_in_use(&self) -> usize {
        self.gateway.pool().capacity() - self.gateway.pool().free()
    }

    /// The names of the serial devices.
    pub fn devices(&self) -> impl Iterator<Item = &str> {
        self.lines.iter().map(|line| line.device.as_str())
    }

    /// A client on the machine `from`, connected to the gateway's TCP `port`.
    pub fn client(&self, from: IpAddr, port: u16) -> Client {
        Client::new(self.network.connect(from, port).expect("the gateway listens"))
    }

    /// The response to a request on a connection of its own to port 502.
    pub fn ask(&self, world: &mut World<'_>, unit: u8, pdu: &[u8]) -> Response {
        let mut client = self.client(machine(1), 502);
        world.run_until(client.request(unit, pdu))
    }

    /// Changes the settings by a line, as a console does; an error is the text that the console would show.
    pub fn console(&self, line: &str) -> Result<(), String> {
        let mut settings = self.gateway.settings(Settings::clone);
        apply(&mut settings, line).map_err(|error| error.to_string())?;
        self.gateway.apply(&settings).map_err(|error| error.to_string())
    }

    /// How often the port called `name` has counted `event`.
    pub fn counted(&self, name: &str, event: Event) -> u32 {
        let port = self.gateway.settings(|settings| settings.find(name));
        let port = port.unwrap_or_else(|| panic!("no port is called {name}"));
        self.gateway.ports()[port.index()].stats.get(event)
    }
}

/// The machine 10.0.0.`host`.
pub const fn machine(host: u8) -> IpAddr {
    IpAddr::V4(Ipv4Addr::new(10, 0, 0, host))
}

#[cfg(test)]
mod tests {
    use mobgate::stats::Event;

    use super::{Response, with_gateway};
    use crate::device::Device;

    const SETTINGS: &str = "port bus serial uart1 rtu client 9600 8E1
        port P502 tcp server 502
        route P502 1-247 * * bus";

    #[test]
    fn a_client_reaches_a_device_through_the_gateway() {
        with_gateway(1, SETTINGS, |world, rig| {
            let wire = rig.wire("uart1");
            world.spawn(Device::new(5).run(wire.tap(rig.end("uart1").line())));
            assert_eq!(rig.ask(world, 5, &[3, 0, 7, 0, 1]), Response::Pdu(vec![3, 2, 5, 7]));
            assert_eq!(rig.counted("bus", Event::Response), 1);
            assert_eq!(wire.collisions(), 0);
        });
    }
}
