//! A gateway in a world: its statics, its tasks, and the settings that a test gives as lines.

use std::net::{IpAddr, Ipv4Addr};

use mobgate::config::{LineSettings, Loader, PORTS_MAX, PortId, PortKind, Settings};
use mobgate::frame::{FramePool, Slot};
use mobgate::gateway::{Gateway, PortPlace, Seat};
use mobgate::stats::Event;

use crate::{Client, Device, Network, SimSerial, Wire, World, device};

/// Frames of the rig's gateway beyond the one that each seat has of its own.
pub const SHARED_FRAMES: usize = 32;
/// Connections of the rig's gateway, over all its TCP servers.
pub const SEATS: usize = 80;

/// A running gateway and its surroundings.
pub struct Rig<'w> {
    /// The gateway; its tasks run in the world.
    pub gateway: &'w Gateway<'w>,
    /// The network that its TCP servers listen at.
    pub network: Network,
    wires: Vec<(String, Wire)>,
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
    let serial = |port: &mobgate::config::Port| match &port.kind {
        PortKind::Serial(serial) => Some((serial.device.as_str().to_owned(), Wire::new(), serial.line)),
        PortKind::TcpServer(_) => None,
    };
    let lines: Vec<(String, Wire, LineSettings)> =
        settings.ports.iter().flatten().filter_map(serial).collect();
    let host =
        lines.iter().fold(SimSerial::new(), |host, (name, wire, line)| host.with(name, &wire.tap(*line)));
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
    let wires = lines.into_iter().map(|(name, wire, _)| (name, wire)).collect();
    let rig = Rig { gateway: &gateway, network, wires };
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

impl<'w> Rig<'w> {
    /// The wire behind the serial device `name`.
    ///
    /// # Panics
    /// When no port names it.
    pub fn wire(&self, name: &str) -> &Wire {
        let (_, wire) = self.wires.iter().find(|(other, _)| other == name).expect("a device of the settings");
        wire
    }

    /// The settings of the line `name`.
    ///
    /// # Panics
    /// When no port names it.
    pub fn line(&self, name: &str) -> LineSettings {
        self.gateway.settings(|settings| {
            let mut serial = settings.ports.iter().flatten().filter_map(|port| match &port.kind {
                PortKind::Serial(serial) if serial.device == name => Some(serial.line),
                _ => None,
            });
            serial.next().expect("a device of the settings")
        })
    }

    /// Puts `devices` on the wire `name`, at one connection to it and with the line's own settings.
    pub fn attach(&self, world: &World<'w>, name: &str, devices: &[Device]) {
        let end = self.wire(name).tap(self.line(name));
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
