//! The gateway's settings as values: ports, routing rules, and their limits.
//!
//! A line typed at the console, or read from the configuration file, becomes a change of a [`Settings`] value; the value
//! is checked, then the gateway takes it over and restarts the ports that differ. [`apply`] and [`write_line`] parse and
//! print the one language in which all of that is written.

mod address;
mod ethercat;
mod field;
mod line;
mod loader;
mod mdns;
mod network;
mod own_network;
mod point_checks;
mod point_problem;
mod point_words;
mod points;
mod port_fields;
mod port_keys;
mod port_values;
mod port_words;
mod print;
mod problem;
mod proof;
mod review;
mod route_words;
mod saved;
mod serial;
mod servers;
mod slaves;
mod text;
mod values;
mod words;

#[cfg(test)]
mod tests;

use heapless::{String, Vec};

pub(crate) use self::address::Endpoint;
pub use self::address::{Allowed, IpPrefix};
pub use self::ethercat::{EthercatSettings, INTERFACE_BYTES_MAX, InterfaceName, OnLoss};
pub(crate) use self::line::LineBuffer;
pub use self::loader::{LoadError, Loader, Look};
pub use self::mdns::Mdns;
pub(crate) use self::mdns::keywords as mdns_words;
pub use self::network::{
    MODBUS_TCP_PORT, StreamFraming, TcpClientSettings, TcpListen, TcpServerSettings, UDP_REQUESTS_MAX,
    UdpServerSettings,
};
pub(crate) use self::own_network::keywords as network_words;
pub use self::own_network::{HOST_NAME_BYTES_MAX, HostName, OwnNetwork, StaticAddress};
pub use self::point_problem::PointProblem;
pub(crate) use self::point_words::{KINDS, ORDERS, ORDERS_EXPECTED, TYPES, TYPES_EXPECTED};
pub use self::points::{
    DeviceSettings, LABEL_BYTES_MAX, Label, POINTS_MAX, PointAt, PointName, PointSettings,
};
pub(crate) use self::points::{Reloaded, load as load_points};
pub use self::print::{SPEED_BYTES_MAX, write_line};
pub use self::problem::{LineError, Problem, Rules, WORD_BYTES_MAX, Warning};
pub use self::proof::{PROOFS_MAX, Proof, Proofs};
pub(crate) use self::route_words::units as parse_units;
pub use self::saved::{ReadError, read_store, write_store};
pub use self::serial::{
    Driver, Framing, LineSettings, Parity, SerialClientSettings, SerialServerSettings, SerialSettings,
};
pub(crate) use self::servers::SERVERS;
pub use self::servers::{
    Host, PORT_SERVERS_MAX, SERVER_NAME_BYTES_MAX, SERVERS_MAX, SOCKETS_MAX, ServerAddress, ServerName,
    ServerSettings,
};
pub use self::slaves::{Cells, OnSilence, SLAVES_MAX, SlaveSettings};
pub(crate) use self::text::option_words;
pub use self::text::{Applied, apply, is_implied};
pub use self::values::Time;
pub(crate) use self::values::{medium, number, parse_number, small, time};
pub(crate) use self::words::{Word, Words, Wrong, find_word};
use crate::route::{Destination, Route};
use crate::scanner::{DEVICES_MAX, POINTS};

/// Longest line of the line language in bytes. Settings at their limits print shorter ones: what is printed can be read.
pub const LINE_BYTES_MAX: usize = if PATHS { 800 } else { 640 };
/// Ports that settings can hold. With the feature `small`: as many as small boards run.
pub const PORTS_MAX: usize = if cfg!(feature = "small") { 8 } else { 16 };
/// Routing rules that settings can hold.
pub const ROUTES_MAX: usize = 64;
/// Longest port name in bytes.
pub const NAME_BYTES_MAX: usize = 15;
/// Longest device name in bytes: with the feature `paths` that of a file, since names under `/dev/serial/by-id` have more than
/// 100. Boards name UARTs.
pub const DEVICE_BYTES_MAX: usize = if PATHS { 255 } else { 15 };
const PATHS: bool = cfg!(feature = "paths");
/// Address prefixes in one list of a TCP server.
pub const RESERVED_MAX: usize = 4;

/// Such a list. Each port's settings have two, in several copies: its length is a byte.
pub type Prefixes = Vec<IpPrefix, RESERVED_MAX, u8>;

/// A port's name, as rules call it.
pub type Name = String<NAME_BYTES_MAX>;

/// A port's place in the settings, stable while the port exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PortId(pub u8);

impl PortId {
    /// The place as an index.
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

/// Everything that `save` keeps and `show config` prints.
#[derive(Debug, PartialEq, Eq, Default)]
pub struct Settings {
    /// How the board comes by its own address, where that is the gateway's business; `None`: as it does by default.
    pub network: Option<OwnNetwork>,
    /// How it is found on the network.
    pub mdns: Mdns,
    /// The ports; a place keeps its index while other ports come and go.
    pub ports: [Option<Port>; PORTS_MAX],
    /// The servers of TCP clients that have several.
    pub servers: Vec<ServerSettings, SERVERS_MAX>,
    /// The routing rules in the order in which they are tried.
    pub routes: Vec<Route, ROUTES_MAX>,
    /// The devices that the scanner asks.
    pub devices: Vec<DeviceSettings, DEVICES_MAX>,
    /// The points, in devices and in the gateway's own unit.
    pub points: Vec<PointSettings, POINTS_MAX>,
    /// The devices behind the EtherCAT process image, in the order of their values.
    pub slaves: Vec<SlaveSettings, SLAVES_MAX>,
}

impl Settings {
    /// No ports, no rules.
    pub const fn new() -> Self {
        Self {
            network: None,
            mdns: Mdns::DEFAULT,
            ports: [const { None }; PORTS_MAX],
            servers: Vec::new(),
            routes: Vec::new(),
            devices: Vec::new(),
            points: Vec::new(),
            slaves: Vec::new(),
        }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.network = None;
        self.mdns = Mdns::DEFAULT;
        self.ports.iter_mut().for_each(|port| *port = None);
        self.servers.clear();
        self.routes.clear();
        self.devices.clear();
        self.points.clear();
        self.slaves.clear();
    }

    /// How the board comes by its own address.
    pub fn own_network(&self) -> OwnNetwork {
        self.network.clone().unwrap_or_default()
    }

    /// The port at `id`.
    pub fn port(&self, id: PortId) -> Option<&Port> {
        self.ports.get(id.index())?.as_ref()
    }

    /// The port called `name`; a bare TCP port number also finds the port called `P` and that number, because
    /// the source paper prints `502` for P502.
    pub fn find(&self, name: &str) -> Option<PortId> {
        let named = |wanted: &dyn Fn(&str) -> bool| {
            self.ports.iter().position(|port| port.as_ref().is_some_and(|port| wanted(&port.name)))
        };
        let found = named(&|other| other.eq_ignore_ascii_case(name)).or_else(|| {
            let digits = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_digit());
            if !digits {
                return None;
            }
            named(&|other| other.strip_prefix(['P', 'p']) == Some(name))
        })?;
        Some(PortId(found as u8))
    }

    /// The TCP server at `id`, if the port is one.
    pub fn tcp_server(&self, id: PortId) -> Option<&TcpServerSettings> {
        match &self.port(id)?.kind {
            PortKind::TcpServer(settings) => Some(settings),
            _ => None,
        }
    }

    /// The name of the port at `id`; `?` when there is none any more.
    pub fn name(&self, id: PortId) -> &str {
        self.port(id).map_or("?", |port| &port.name)
    }

    /// A destination as rules name it.
    pub fn destination(&self, destination: Destination) -> &str {
        match destination {
            Destination::Port(id) => self.name(id),
            Destination::Local => "local",
            Destination::Discard => "discard",
            Destination::NoPath => "nopath",
        }
    }
}

impl Clone for Settings {
    fn clone(&self) -> Self {
        let mut clone = Self::new();
        clone.clone_from(self);
        clone
    }

    /// Copies part by part: the whole is too big for the stack of a small board.
    fn clone_from(&mut self, source: &Self) {
        let Self { network, mdns, ports, servers, routes, devices, points, slaves } = source;
        self.network.clone_from(network);
        self.mdns.clone_from(mdns);
        self.ports.clone_from_slice(ports);
        if SERVERS {
            copy_list(&mut self.servers, servers);
        }
        copy_list(&mut self.routes, routes);
        if POINTS {
            copy_list(&mut self.devices, devices);
            copy_list(&mut self.points, points);
            copy_list(&mut self.slaves, slaves);
        }
    }
}

fn copy_list<T: Clone, const N: usize>(list: &mut Vec<T, N>, source: &Vec<T, N>) {
    list.clear();
    // The same number fits.
    let _ = list.extend_from_slice(source);
}

/// One port: what it is called and what it does.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Port {
    /// Unique, without regard to case.
    pub name: Name,
    /// What the port is and how it is set.
    pub kind: PortKind,
    /// What special unit ids mean here; used when the port plays the server.
    pub units: UnitPolicy,
}

/// What the unit ids mean that are no device's own: 0 is the broadcast, 248 to 255 are reserved (Serial Line 2.2), and 255 is
/// the TCP device itself (Messaging on TCP/IP 4.4.1.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct UnitPolicy {
    /// Unit 0.
    pub broadcast: Special,
    /// A TCP client's broadcast is answered as if it were a write to one device.
    pub confirm: bool,
    /// Unit 255.
    pub unit_255: Special,
    /// Units 248 to 254.
    pub reserved: Special,
}

impl UnitPolicy {
    /// What `unit` means.
    pub const fn of(&self, unit: u8) -> Special {
        match unit {
            0 => self.broadcast,
            248..=254 => self.reserved,
            255 => self.unit_255,
            _ => Special::Rules,
        }
    }
}

/// What a special unit id means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Special {
    /// What the rules say, as for any other.
    #[default]
    Rules,
    /// Nothing: 0Ah to a TCP client, silence on a serial line.
    Off,
    /// The gateway's own unit.
    Local,
    /// This unit, for which the rules are asked.
    Replace(u8),
    /// Unit 0 only: every serial line that the rules of this port lead to.
    AllLines,
}

/// The kinds of port.
// They lie in one table without a heap. On hosts the name of a serial device makes one much larger than the others.
#[cfg_attr(feature = "paths", allow(clippy::large_enum_variant))]
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PortKind {
    /// An RS-485 or RS-232 line.
    Serial(SerialSettings),
    /// A listener for Modbus TCP clients.
    TcpServer(TcpServerSettings),
    /// A device behind Modbus TCP, or RTU over TCP.
    TcpClient(TcpClientSettings),
    /// A listener for Modbus UDP clients.
    UdpServer(UdpServerSettings),
    /// Asks the devices of data points.
    Scanner,
    /// Asks the devices of the EtherCAT process image.
    Ethercat(EthercatSettings),
}

impl PortKind {
    /// Which side of the protocol the port plays.
    pub const fn side(&self) -> Side {
        match self {
            Self::Serial(settings) => settings.side,
            Self::TcpServer(_) | Self::UdpServer(_) | Self::Scanner | Self::Ethercat(_) => Side::Server,
            Self::TcpClient(_) => Side::Client,
        }
    }

    /// Whether the port asks by itself, for nobody outside.
    pub const fn asks_by_itself(&self) -> bool {
        matches!(self, Self::Scanner | Self::Ethercat(_))
    }

    /// Whether whoever asks by this port has an IP address.
    pub const fn has_peers(&self) -> bool {
        !matches!(self, Self::Serial(_) | Self::Scanner | Self::Ethercat(_))
    }
}

/// Which side of the protocol a port plays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Sends requests to outside servers (the gateway is the master).
    Client,
    /// Brings requests to the gateway: it answers an outside client (the gateway is a slave), or asks by itself.
    Server,
}
