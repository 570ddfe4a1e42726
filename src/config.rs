//! The gateway's settings as values: ports, routing rules, and their limits.
//!
//! A line typed at the console, or read from the configuration file, becomes a change of a [`Settings`] value; the value
//! is checked, then the gateway takes it over and restarts the ports that differ. [`apply`] and [`write_line`] parse and
//! print the one language in which all of that is written.

mod line;
mod loader;
mod network;
mod network_words;
mod port_keys;
mod port_words;
mod print;
mod problem;
mod route_words;
mod saved;
mod text;
mod unit_words;
mod values;
mod words;

#[cfg(test)]
mod tests;

use core::net::IpAddr;

use embassy_time::Duration;
use heapless::{String, Vec};

pub(crate) use self::line::LineBuffer;
pub use self::loader::{LoadError, Loader};
pub use self::network::{
    MODBUS_TCP_PORT, StreamFraming, TcpClientSettings, UDP_REQUESTS_MAX, UdpServerSettings,
};
pub use self::print::{SPEED_BYTES_MAX, write_line};
pub use self::problem::{LineError, Problem, Rules, WORD_BYTES_MAX, Warning};
pub use self::saved::{ReadError, read_store, write_store};
pub(crate) use self::text::option_words;
pub use self::text::{Applied, apply, is_implied};
pub use self::values::Time;
pub(crate) use self::words::Words;
use crate::route::{Destination, Route};

/// Longest line of the line language in bytes. Settings at their limits print lines of about 340: what is printed can be read.
pub const LINE_BYTES_MAX: usize = 640;
/// Ports that settings can hold.
pub const PORTS_MAX: usize = 16;
/// Routing rules that settings can hold.
pub const ROUTES_MAX: usize = 64;
/// Longest port name in bytes.
pub const NAME_BYTES_MAX: usize = 15;
/// Longest device name in bytes: names under `/dev/serial/by-id` come near it.
pub const DEVICE_BYTES_MAX: usize = 96;
/// Address prefixes in one list of a TCP server.
pub const RESERVED_MAX: usize = 4;

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
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Settings {
    /// The ports; a place keeps its index while other ports come and go.
    pub ports: [Option<Port>; PORTS_MAX],
    /// The routing rules in the order in which they are tried.
    pub routes: Vec<Route, ROUTES_MAX>,
}

impl Settings {
    /// No ports, no rules.
    pub const fn new() -> Self {
        Self { ports: [const { None }; PORTS_MAX], routes: Vec::new() }
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

    /// What is set, but unlikely to be meant.
    pub fn warnings(&self) -> impl Iterator<Item = Warning> {
        self.ports.iter().flatten().filter_map(gap_warning)
    }
}

/// A warning when `port` keeps less silence between RTU frames than the specification asks for.
fn gap_warning(port: &Port) -> Option<Warning> {
    let PortKind::Serial(SerialSettings { framing: Framing::Rtu, line, .. }) = &port.kind else {
        return None;
    };
    let (gap, t3_5) = (line.gap(), line.t3_5());
    (gap < t3_5).then(|| Warning::GapBelowSpecification { port: port.name.clone(), gap, t3_5 })
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
}

impl PortKind {
    /// Which side of the protocol the port plays.
    pub const fn side(&self) -> Side {
        match self {
            Self::Serial(settings) => settings.side,
            Self::TcpServer(_) | Self::UdpServer(_) => Side::Server,
            Self::TcpClient(_) => Side::Client,
        }
    }
}

/// Which side of the protocol a port plays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Sends requests to outside servers (the gateway is the master).
    Client,
    /// Answers an outside client (the gateway is a slave).
    Server,
}

/// How frames look on a serial line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Framing {
    /// Binary frames ended by silence.
    Rtu,
    /// Hexadecimal frames between `:` and CR LF.
    Ascii,
}

/// A serial port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SerialSettings {
    /// The board's name for the line: `uart1`, `/dev/ttyUSB0`.
    pub device: String<DEVICE_BYTES_MAX>,
    /// RTU or ASCII.
    pub framing: Framing,
    /// Client or server.
    pub side: Side,
    /// Speed, format and gaps.
    pub line: LineSettings,
    /// How requests are sent; used when `side` is [`Side::Client`].
    pub client: SerialClientSettings,
    /// How requests are answered; used when `side` is [`Side::Server`].
    pub server: SerialServerSettings,
}

/// Speed, character format and silent intervals of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineSettings {
    /// Bits per second, 1 to 10 000 000.
    pub baud: u32,
    /// 7 or 8.
    pub data_bits: u8,
    /// Parity bit.
    pub parity: Parity,
    /// 1 or 2.
    pub stop_bits: u8,
    /// Silence between frames; `None` is the specification's t3.5.
    pub gap: Option<Duration>,
    /// Longest silence inside a frame; `None` is the general rule (a frame ends after the gap).
    pub char_timeout: Option<Duration>,
    /// Who switches the transceiver's driver.
    pub driver: Driver,
    /// From switching the driver on to the first start bit.
    pub driver_before: Duration,
    /// From the last stop bit to switching the driver off.
    pub driver_after: Duration,
    /// The adapter hears itself: what comes back is compared with what was sent, and dropped.
    pub echo: bool,
}

/// Who switches the transceiver of a two-wire line from hearing to speaking and back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Driver {
    /// Nobody needs to: RS-232, four wires, or an adapter that does it by itself.
    Automatic,
    /// The hardware or its driver (Linux: TIOCSRS485); refused where it cannot.
    Rs485,
    /// The gateway, by RTS.
    Rts,
}

/// Parity of a character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    None,
    /// Even number of ones.
    Even,
    /// Odd number of ones.
    Odd,
}

impl LineSettings {
    /// Modbus over Serial Line 2.5.1: 19200 baud, even parity.
    pub const DEFAULT: Self = Self {
        baud: 19_200,
        data_bits: 8,
        parity: Parity::Even,
        stop_bits: 1,
        gap: None,
        char_timeout: None,
        driver: Driver::Automatic,
        driver_before: Duration::from_ticks(0),
        driver_after: Duration::from_ticks(0),
        echo: false,
    };

    /// Bits of one character on the wire: start, data, parity, stop.
    pub const fn bits_per_char(&self) -> u32 {
        1 + self.data_bits as u32 + !matches!(self.parity, Parity::None) as u32 + self.stop_bits as u32
    }

    /// Time of `chars` characters on the wire, rounded up to the clock's tick.
    pub fn chars(&self, chars: usize) -> Duration {
        let bits = chars as u64 * self.bits_per_char() as u64;
        Duration::from_nanos((bits * 1_000_000_000).div_ceil(self.baud as u64))
    }

    /// The specification's t3.5: 3.5 characters, fixed at 1.750 ms above 19200 baud (Serial Line 2.5.1.1).
    pub fn t3_5(&self) -> Duration {
        if self.baud > 19_200 {
            return Duration::from_micros(1_750);
        }
        let half_bits = 7 * self.bits_per_char() as u64;
        Duration::from_nanos((half_bits * 1_000_000_000).div_ceil(2 * self.baud as u64))
    }

    /// The silence that ends a frame and must precede one.
    pub fn gap(&self) -> Duration {
        self.gap.unwrap_or_else(|| self.t3_5())
    }
}

/// How a client-side port sends requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SerialClientSettings {
    /// From the last bit of the request to the first character of the response.
    pub timeout: Duration,
    /// Repeats of a read that got no or a damaged response. Writes are never repeated.
    pub retries: u8,
    /// Pause after a broadcast.
    pub turnaround: Duration,
    /// Silence after the port is opened, for devices that are still starting.
    pub start_delay: Duration,
    /// How long after a time-out the unit gets no request, because its answer may still come; `None`: `timeout`.
    pub late_window: Option<Duration>,
    /// Time-outs in a row after which a unit counts as down and fails at once; 0 never.
    pub down_after: u8,
}

impl SerialClientSettings {
    /// One second, no repeats, 100 ms after a broadcast, down after three.
    pub const DEFAULT: Self = Self {
        timeout: Duration::from_secs(1),
        retries: 0,
        turnaround: Duration::from_millis(100),
        start_delay: Duration::from_ticks(0),
        late_window: None,
        down_after: 3,
    };
}

/// How a server-side serial port answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SerialServerSettings {
    /// From the request to the answer. After this time the master has given up: there is no answer, and a request not
    /// yet on its destination's wire is not sent any more.
    pub answer_within: Duration,
    /// Least time from the end of the request to the answer, for masters that are slow to listen; never below the gap.
    pub reply_delay: Duration,
}

impl SerialServerSettings {
    /// An answer within 3 s, as soon as there is one.
    pub const DEFAULT: Self =
        Self { answer_within: Duration::from_secs(3), reply_delay: Duration::from_ticks(0) };
}

/// Where a TCP or UDP server listens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TcpListen {
    /// The local address; `None` is all of them.
    pub address: Option<IpAddr>,
    /// TCP or UDP port number, 1 to 65535.
    pub port: u16,
}

impl TcpListen {
    /// Whether a system would refuse to open both: the same port at the same address, or at all addresses.
    pub fn collides(&self, other: &Self) -> bool {
        let all = |listen: &Self| listen.address.is_none_or(|address| address.is_unspecified());
        self.port == other.port && (all(self) || all(other) || self.address == other.address)
    }
}

/// A listener for Modbus TCP clients.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TcpServerSettings {
    /// Where it listens.
    pub listen: TcpListen,
    /// Modbus TCP or RTU over TCP.
    pub framing: StreamFraming,
    /// Connections at a time. One more is accepted for a moment, to decide who goes.
    pub clients: u16,
    /// A connection without a request for so long is closed; zero never.
    pub idle: Duration,
    /// Requests of one connection that may be open at a time; one more is answered 06h. 1 to 16; with RTU over TCP it is one,
    /// and the next waits.
    pub pipeline: u8,
    /// A request not yet on the wire after this time is not sent any more, and answered 0Bh.
    pub lifetime: Duration,
    /// Of `clients`, places kept for `reserved_for`.
    pub reserved: u16,
    /// Peers that may use the reserved places and are never closed to make room.
    pub reserved_for: Vec<IpPrefix, RESERVED_MAX>,
    /// Peers that may connect; others are closed at once. Empty: everybody may (Messaging on TCP/IP 4.2.3, restricted mode).
    pub allowed: Allowed,
}

/// Peers that may ask; empty: everybody may.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Allowed(pub Vec<IpPrefix, RESERVED_MAX>);

impl Allowed {
    /// Everybody.
    pub const fn everybody() -> Self {
        Self(Vec::new())
    }

    /// Whether `peer` may ask.
    pub fn admits(&self, peer: IpAddr) -> bool {
        self.0.is_empty() || self.0.iter().any(|prefix| prefix.contains(peer))
    }
}

impl TcpServerSettings {
    /// A listener on `port` with the defaults: 16 clients, a minute idle, 16 requests each, 5 s of life.
    pub fn new(port: u16) -> Self {
        Self {
            listen: TcpListen { address: None, port },
            framing: StreamFraming::Mbap,
            clients: 16,
            idle: Duration::from_secs(60),
            pipeline: 16,
            lifetime: Duration::from_secs(5),
            reserved: 0,
            reserved_for: Vec::new(),
            allowed: Allowed::everybody(),
        }
    }
}

/// An IP address with a prefix length; a full length names one address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IpPrefix {
    /// The address; bits behind the prefix are zero.
    pub address: IpAddr,
    /// Leading bits that must agree: up to 32 for IPv4, up to 128 for IPv6.
    pub length: u8,
}

impl IpPrefix {
    /// Whether `peer` lies in the prefix. An IPv4 peer written as IPv6 (`::ffff:a.b.c.d`) counts as IPv4.
    pub fn contains(&self, peer: IpAddr) -> bool {
        match (self.address.to_canonical(), peer.to_canonical()) {
            (IpAddr::V4(own), IpAddr::V4(peer)) => {
                let shift = 32 - u32::from(self.length.min(32));
                own.to_bits().checked_shr(shift).unwrap_or(0)
                    == peer.to_bits().checked_shr(shift).unwrap_or(0)
            }
            (IpAddr::V6(own), IpAddr::V6(peer)) => {
                let shift = 128 - u32::from(self.length.min(128));
                own.to_bits().checked_shr(shift).unwrap_or(0)
                    == peer.to_bits().checked_shr(shift).unwrap_or(0)
            }
            _ => false,
        }
    }
}
