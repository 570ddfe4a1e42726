//! The keywords of ports.

use super::values::parse_number;
use super::words::Word;
use crate::scanner::POINTS;
use crate::settings::{Driver, Framing, PortKind, Side, StreamFraming};

/// What a keyword of a port line sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Key {
    Device,
    Framing(Framing),
    Side(Side),
    Baud,
    Format,
    CharTimeout,
    Gap,
    Driver(Driver),
    DriverBefore,
    DriverAfter,
    Echo(bool),
    AnswerWithin,
    ReplyDelay,
    Timeout,
    Retries,
    Turnaround,
    StartDelay,
    LateWindow,
    DownAfter,
    Proof,
    Listen,
    Clients,
    Idle,
    Pipeline,
    Lifetime,
    Full,
    Reserve,
    Allow,
    Stream(StreamFraming),
    Server,
    Sockets,
    Unit,
    InFlight,
    ConnectTimeout,
    ConnectDelay,
    RequestDelay,
    Requests,
    OnLoss,
    Line,
    Broadcast,
    Confirm(bool),
    Unit255,
    ReservedUnits,
    ProveOutputs(bool),
    Interface,
    Id,
    Emergencies(bool),
    Modules(bool),
}

impl Key {
    /// The bit that records that a line has set it.
    pub(crate) const fn bit(self) -> u64 {
        1 << match self {
            Self::Device => 0,
            Self::Framing(_) => 1,
            Self::Side(_) => 2,
            Self::Baud => 3,
            Self::Format => 4,
            Self::CharTimeout => 5,
            Self::Gap => 6,
            Self::Driver(_) => 7,
            Self::DriverBefore => 8,
            Self::DriverAfter => 9,
            Self::Echo(_) => 10,
            Self::AnswerWithin => 11,
            Self::ReplyDelay => 12,
            Self::Timeout => 13,
            Self::Retries => 14,
            Self::Turnaround => 15,
            Self::StartDelay => 16,
            Self::LateWindow => 17,
            Self::DownAfter => 18,
            Self::Listen => 19,
            Self::Clients => 20,
            Self::Idle => 21,
            Self::Pipeline => 22,
            Self::Lifetime => 23,
            Self::Reserve => 24,
            Self::Allow => 25,
            Self::Stream(_) => 26,
            Self::Server => 27,
            Self::Unit => 28,
            Self::InFlight => 29,
            Self::ConnectTimeout => 30,
            Self::ConnectDelay => 31,
            Self::RequestDelay => 32,
            Self::Requests => 33,
            Self::OnLoss => 34,
            Self::Line => 35,
            Self::Broadcast => 36,
            Self::Confirm(_) => 37,
            Self::Unit255 => 38,
            Self::ReservedUnits => 39,
            Self::Proof => 40,
            Self::ProveOutputs(_) => 41,
            Self::Full => 42,
            Self::Interface => 43,
            Self::Sockets => 44,
            Self::Id => 45,
            Self::Emergencies(_) => 46,
            Self::Modules(_) => 47,
        }
    }
}

/// Whether `word` is a keyword of TCP clients, and so cannot be a server name.
pub(crate) fn is_of_tcp_client(word: Word) -> bool {
    word.lookup(TCP_CLIENT_KEYS).is_some()
}

/// Whether `word` sets something in a serial line: then it is no device's name.
pub(crate) fn is_of_serial(word: Word) -> bool {
    word.lookup(SERIAL_KEYS).is_some() || parse_number(word.text).is_some()
}

/// Keywords with their keys, in printing order.
pub(crate) type Keys = &'static [(&'static str, Key)];

const SERIAL_KEYS: Keys = &[
    ("device", Key::Device),
    ("rtu", Key::Framing(Framing::Rtu)),
    ("ascii", Key::Framing(Framing::Ascii)),
    ("client", Key::Side(Side::Client)),
    ("server", Key::Side(Side::Server)),
    ("master", Key::Side(Side::Client)),
    ("slave", Key::Side(Side::Server)),
    ("char-timeout", Key::CharTimeout),
    ("gap", Key::Gap),
    ("rs485", Key::Driver(Driver::Rs485)),
    ("rts", Key::Driver(Driver::Rts)),
    // For `edit`: resets a flag.
    ("rs232", Key::Driver(Driver::Automatic)),
    ("driver-before", Key::DriverBefore),
    ("driver-after", Key::DriverAfter),
    ("echo", Key::Echo(true)),
    ("no-echo", Key::Echo(false)),
    ("answer-within", Key::AnswerWithin),
    ("reply-delay", Key::ReplyDelay),
    ("timeout", Key::Timeout),
    ("retries", Key::Retries),
    ("turnaround", Key::Turnaround),
    ("start-delay", Key::StartDelay),
    ("late-window", Key::LateWindow),
    ("down-after", Key::DownAfter),
    ("proof", Key::Proof),
];

const TCP_SERVER_KEYS: Keys = &[
    ("listen", Key::Listen),
    ("rtu", Key::Stream(StreamFraming::Rtu)),
    ("capture", Key::Stream(StreamFraming::Capture)),
    // For `edit`: resets a flag.
    ("mbap", Key::Stream(StreamFraming::Mbap)),
    ("clients", Key::Clients),
    ("idle", Key::Idle),
    ("pipeline", Key::Pipeline),
    ("lifetime", Key::Lifetime),
    ("full", Key::Full),
    ("reserve", Key::Reserve),
    ("allow", Key::Allow),
];

const TCP_CLIENT_KEYS: Keys = &[
    ("address", Key::Server),
    ("rtu", Key::Stream(StreamFraming::Rtu)),
    // For `edit`: resets a flag.
    ("mbap", Key::Stream(StreamFraming::Mbap)),
    ("sockets", Key::Sockets),
    ("unit", Key::Unit),
    ("in-flight", Key::InFlight),
    ("timeout", Key::Timeout),
    ("connect-timeout", Key::ConnectTimeout),
    ("connect-delay", Key::ConnectDelay),
    ("request-delay", Key::RequestDelay),
    ("idle", Key::Idle),
    ("retries", Key::Retries),
    ("late-window", Key::LateWindow),
    ("down-after", Key::DownAfter),
    ("proof", Key::Proof),
];

const UDP_SERVER_KEYS: Keys = &[
    ("listen", Key::Listen),
    ("pipeline", Key::Pipeline),
    ("requests", Key::Requests),
    ("lifetime", Key::Lifetime),
    ("allow", Key::Allow),
];

const ETHERCAT_KEYS: Keys = if POINTS { WITH_CONTROLLER_KEYS } else { &[] };
const WITH_CONTROLLER_KEYS: Keys = &[
    ("interface", Key::Interface),
    ("line", Key::Line),
    ("on-loss", Key::OnLoss),
    ("id", Key::Id),
    ("modules", Key::Modules(true)),
    // For `edit`: resets a flag.
    ("no-modules", Key::Modules(false)),
    ("emergencies", Key::Emergencies(true)),
    // For `edit`: resets a flag.
    ("no-emergencies", Key::Emergencies(false)),
    ("prove-outputs", Key::ProveOutputs(true)),
    // For `edit`: resets a flag.
    ("no-prove-outputs", Key::ProveOutputs(false)),
];

/// The keywords for special unit ids, common to all server-side ports: 0, 255, 248 to 254.
pub(crate) const UNIT_KEYS: Keys = &[
    ("broadcast", Key::Broadcast),
    ("confirm-broadcast", Key::Confirm(true)),
    // For `edit`: resets a flag.
    ("no-confirm-broadcast", Key::Confirm(false)),
    ("unit-255", Key::Unit255),
    ("reserved-units", Key::ReservedUnits),
];

impl PortKind {
    /// The keywords of this kind of port, and how an error lists them.
    pub(crate) const fn words(&self) -> (Keys, &'static str) {
        match self {
            Self::Serial(_) => (SERIAL_KEYS, SERIAL_EXPECTED),
            Self::TcpServer(_) => (TCP_SERVER_KEYS, TCP_SERVER_EXPECTED),
            Self::TcpClient(_) => (TCP_CLIENT_KEYS, TCP_CLIENT_EXPECTED),
            Self::UdpServer(_) => (UDP_SERVER_KEYS, UDP_SERVER_EXPECTED),
            Self::Ethercat(_) => (ETHERCAT_KEYS, ETHERCAT_EXPECTED),
            Self::Scanner => (&[], ""),
        }
    }
}

const SERIAL_EXPECTED: &str = "rtu, ascii, client, server, a baud rate, a format (8E1), device, timeout, \
     char-timeout, gap, rs485, rts, driver-before, driver-after, echo, retries, turnaround, start-delay, late-window, \
     down-after, proof, answer-within or reply-delay";

const TCP_SERVER_EXPECTED: &str =
    "listen, rtu, capture, clients, idle, pipeline, lifetime, full, reserve or allow";

const TCP_CLIENT_EXPECTED: &str = "address, rtu, sockets, unit, in-flight, timeout, connect-timeout, \
     connect-delay, request-delay, idle, retries, late-window, down-after or proof";

const UDP_SERVER_EXPECTED: &str = "listen, pipeline, requests, lifetime or allow";

const ETHERCAT_EXPECTED: &str = "interface, line, on-loss, id, modules, emergencies or prove-outputs";

/// Calls `each` with the keywords of all ports.
pub(crate) fn keywords(each: &mut dyn FnMut(&'static str)) {
    let tables = [SERIAL_KEYS, TCP_SERVER_KEYS, TCP_CLIENT_KEYS, UDP_SERVER_KEYS, ETHERCAT_KEYS, UNIT_KEYS];
    for (nth, table) in tables.into_iter().enumerate() {
        for &(keyword, _) in table {
            // Several ports have a `timeout`: it is one keyword.
            let is_known = |earlier: Keys| earlier.iter().any(|(known, _)| *known == keyword);
            if !tables.into_iter().take(nth).any(is_known) {
                each(keyword);
            }
        }
    }
}
