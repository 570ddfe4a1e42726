//! Errors and warnings about lines.

use core::fmt;
use core::num::NonZeroU16;

use embassy_time::Duration;
use heapless::String;
use thiserror::Error;

use super::point_problem::PointProblem;
use crate::scanner::POINTS;
use crate::settings::{LINE_BYTES_MAX, Name, PORTS_MAX, ROUTES_MAX, Rules, Time, UnitRange};

/// Bytes of a wrong word that an error stores.
pub const WORD_BYTES_MAX: usize = 32;

/// The error of a line that changed nothing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineError {
    /// Where the wrong word starts, in characters from 1.
    pub column: usize,
    /// The wrong word, truncated to [`WORD_BYTES_MAX`]; empty at the end of the line.
    pub word: String<WORD_BYTES_MAX>,
    /// What is wrong with it.
    pub(crate) problem: Problem,
}

impl LineError {
    pub(crate) fn new(column: usize, text: &str, problem: Problem) -> Self {
        Self { column, word: cut(text), problem }
    }

    /// The line has more than [`LINE_BYTES_MAX`] bytes.
    pub(crate) fn too_long() -> Self {
        Self::new(LINE_BYTES_MAX + 1, "", Problem::LineTooLong)
    }
}

impl fmt::Display for LineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "column {}: ", self.column)?;
        if self.word.is_empty() { f.write_str("end of line") } else { write!(f, "\"{}\"", self.word) }?;
        write!(f, ": {}", self.problem)
    }
}

impl core::error::Error for LineError {}

/// Truncates a word for an error, which also has its column.
pub(crate) fn cut(text: &str) -> String<WORD_BYTES_MAX> {
    let mut word = String::new();
    // It fits.
    let _ = word.push_str(text.get(..text.floor_char_boundary(WORD_BYTES_MAX)).unwrap_or_default());
    word
}

/// Why a word is wrong.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub(crate) enum Problem {
    /// Something else is expected.
    #[error("expected {expected}{}", Suggestion(*near))]
    Expected {
        /// The expected words.
        expected: &'static str,
        /// A keyword that differs by one letter.
        near: Option<&'static str>,
    },
    /// Not a number, or out of range.
    #[error("expected {what} from {low} to {high}")]
    Number {
        /// What is counted.
        what: &'static str,
        /// Lowest value.
        low: u32,
        /// Highest value.
        high: u32,
    },
    /// Not a time, or without a unit.
    #[error("expected a time with its unit, such as 300ms, 1.75ms, 750us, 1s or 2m")]
    TimeUnit,
    /// A time out of range.
    #[error("expected a time from {} to {}", Time(*low), Time(*high))]
    TimeRange {
        /// Shortest.
        low: Duration,
        /// Longest.
        high: Duration,
    },
    /// A word of the line is in the place of a name, which is missing.
    #[error("was taken as {0}")]
    TakenAs(&'static str),
    /// The line sets the same thing twice.
    #[error("is set twice in this line")]
    Twice,
    /// The whole line is too long.
    #[error("the line is longer than {LINE_BYTES_MAX} bytes")]
    LineTooLong,
    /// Not UTF-8 text.
    #[error("the line is not text (UTF-8)")]
    NotText,
    /// There is no port with this name.
    #[error("there is no port of this name")]
    NoSuchPort,
    /// There is no rule with this number.
    #[error("there is no rule of this number (there are {0})")]
    NoSuchRoute(usize),
    /// [`PORTS_MAX`] ports exist.
    #[error("there are {PORTS_MAX} ports already, the maximum")]
    PortsFull,
    /// [`ROUTES_MAX`] rules exist.
    #[error("there are {ROUTES_MAX} rules already, the maximum")]
    RoutesFull,
    /// The board has no data points.
    #[error("this board has no data points")]
    NoPoints,
    /// The image has no longer types, scales and periodic writes.
    #[cfg_attr(feature = "long-values", allow(dead_code))] // Those with them refuse none.
    #[error("this board's image lacks it (feature long-values)")]
    NoLongValues,
    /// A problem with points, devices or slaves.
    #[error(fmt = fmt_points)]
    Points(PointProblem),
    /// The port does not have server lines.
    #[error("is not a tcp client without an address: only that has server lines")]
    NotManyServers,
    /// For clients with several servers.
    #[error("is for a tcp client without an address, which has several servers")]
    HasOneServer,
    /// For clients with one server.
    #[error("is for a tcp client with an address: server lines have tags")]
    HasManyServers,
    /// The port has server lines.
    #[error("{0} server lines name this port: delete them first")]
    ServersInUse(usize),
    /// Two servers would have the same unit.
    #[error("unit {unit} is in the line server ... unit {units} already")]
    UnitTaken {
        /// The unit.
        unit: u8,
        /// The units of the other line.
        units: UnitRange,
    },
    /// There is no room for another server.
    #[error("there are {0} servers already, the maximum")]
    ServersFull(usize),
    /// There is no server with these units.
    #[error("no server line of this port has these units")]
    NoSuchServer,
    /// The feature `servers` is off.
    #[error("on this board a tcp client has one server, at an address")]
    NoServers,
    /// There is no room for another user.
    #[error("there are {0} users already, the maximum")]
    UsersFull(usize),
    /// There is no user of this name.
    #[error("there is no user of this name")]
    NoSuchUser,
    /// No public key.
    // Only with the feature; also below.
    #[cfg_attr(not(feature = "ssh"), allow(dead_code))]
    #[error("expected the key itself, which begins with AAAAC3NzaC1lZDI1NTE5AAAAI: see a file .pub")]
    NoKey,
    /// There is no room for another key.
    #[cfg_attr(not(feature = "ssh"), allow(dead_code))]
    #[error("this user has {0} keys already, the maximum")]
    KeysFull(usize),
    /// The user has no such key.
    #[cfg_attr(not(feature = "ssh"), allow(dead_code))]
    #[error("this user has no such key")]
    NoSuchKey,
    /// The feature `tls` is off.
    #[error("this board has no TLS")]
    NoTls,
    /// A port needs a certificate that is not there.
    // Left out of images without the feature; also below.
    #[cfg(feature = "tls")]
    #[error("there is no line certificate {name} {line}")]
    NoCertificate {
        /// The certificate's name, or `NAME` for any.
        name: Name,
        /// The rest of the line.
        line: &'static str,
    },
    /// There is no certificate of this name.
    #[cfg(feature = "tls")]
    #[error("there is no certificate of this name")]
    NoSuchCertificate,
    /// There is no room for another certificate.
    #[cfg(feature = "tls")]
    #[error("there are {0} certificates already, the maximum")]
    CertificatesFull(usize),
    /// The port needs the certificate as it is.
    #[cfg(feature = "tls")]
    #[error("port {0} needs it: delete or edit the port first")]
    CertificateInUse(Name),
    /// For ports with TLS.
    #[cfg(feature = "tls")]
    #[error("needs tls")]
    TlsOnly,
    /// What does not change is not sent again.
    #[cfg_attr(not(feature = "mqtt"), allow(dead_code))] // As publishers.
    #[error("is not for format sparkplug, which sends what changes")]
    EveryWithSparkplug,
    /// A role for clients that have none.
    #[cfg_attr(not(feature = "tls"), allow(dead_code))] // Told by a branch.
    #[error("clients of this source have no role: only those of a tcp server with tls")]
    NoRoles,
    /// Rules name roles for clients that would have none.
    #[cfg(feature = "tls")]
    #[error("{0} {verb} it with a role; clients have one with tls only", verb = .0.verb("names", "name"))]
    RulesNeedTls(Rules),
    /// The feature `mqtt` is off.
    #[error("this board publishes nothing")]
    NoMqtt,
    /// There is no room for another publisher.
    // Left out of images without the feature; also below.
    #[cfg(feature = "mqtt")]
    #[error("there are {0} publishers already, the maximum")]
    PublishersFull(usize),
    /// There is no publisher of this name.
    #[cfg(feature = "mqtt")]
    #[error("there is no publisher of this name")]
    NoSuchPublisher,
    /// A publisher needs the certificate as it is.
    #[cfg(all(feature = "tls", feature = "mqtt"))]
    #[error("publisher {0} needs it: delete or change its line first")]
    CertificatePublishes(Name),
    /// The feature `users` is off.
    #[error("this board has no users: its console is local")]
    NoUsers,
    /// Not the hash of a password.
    #[error("expected a hash as show config secrets prints it; the command password NAME makes one")]
    NoHash,
    /// RTU characters have 8 data bits (Serial Line 2.5.1).
    #[error("RTU needs 8 data bits, such as 8E1")]
    RtuDataBits,
    /// For the client side.
    #[error("is for the client side only")]
    ClientOnly,
    /// More than one request in flight where only one is possible.
    #[error("cannot be set with rtu, which carries one request at a time")]
    OneAtATime,
    /// Transaction ids tell responses apart.
    #[error("only used with rtu: by Modbus TCP, transaction ids tell responses apart")]
    RtuOnly,
    /// A setting for requests on a port without requests.
    #[error("cannot be set with capture, which accepts no requests")]
    NoRequests,
    /// For the server side.
    #[error("is for the server side only")]
    ServerOnly,
    /// For ports that control the transceiver's driver.
    #[error("needs rs485 or rts")]
    DriverOnly,
    /// More reserved connections than connections.
    #[error("more connections are reserved than the {0} there are")]
    ReservedTooMany(u16),
    /// The port of this name has this device.
    #[error("port {0} has this device")]
    DeviceTaken(Name),
    /// Another port listens at this address.
    #[error("another port listens there")]
    ListenTaken,
    /// The devices of the port of this name may be those of another one.
    #[cfg(feature = "dial-in")] // As these; also below.
    #[error("port {0} has these devices there: tell them apart by allow or first")]
    DevicesTaken(Name),
    /// Devices connect without TLS.
    #[cfg(feature = "dial-in")]
    #[error("cannot be set with listen: devices that connect are served without TLS")]
    DialInWithTls,
    /// There is a web interface.
    // Left out of images without one.
    #[cfg(feature = "web")]
    #[error("there is an http server already")]
    HttpTaken,
    /// Rules refer to the port.
    #[error("{0} {verb} this port: delete or edit first", verb = .0.verb("names", "name"))]
    PortInUse(Rules),
    /// Rules name IP addresses for clients that would have none.
    #[error("{0} {verb} it with an IP address; serial clients have none", verb = .0.verb("names", "name"))]
    RulesNeedTcp(Rules),
    /// An IP address for clients that have none.
    #[error("clients of this source have no IP address: expected *")]
    PeerOfSerial,
    /// A gateway outside the own network.
    #[error("is not another host of the same network")]
    GatewayOutside,
    /// The last unit is before the first.
    #[error("the range ends before it starts")]
    UnitsReversed,
    /// The tag would turn a request to one unit into a broadcast, or into an invalid unit id.
    #[error("unit {unit} would become {target}, {}", outside(*target))]
    TagOutside {
        /// A unit of the rule.
        unit: u8,
        /// The resulting unit.
        target: i16,
    },
    /// A rule from a port to itself.
    #[error("source and destination are the same port")]
    ToItself,
    /// Another rule is identical.
    #[error("rule {0} is the same")]
    SameRoute(NonZeroU16),
}

/// Why this unit cannot be a target.
const fn outside(target: i16) -> &'static str {
    if target == 0 { "a broadcast to all units" } else { "but units are 1 to 247, or 255" }
}

/// Images without points have no such problems, and need not contain their texts.
fn fmt_points(problem: &PointProblem, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    if POINTS { fmt::Display::fmt(problem, f) } else { fmt::Display::fmt(&Problem::NoPoints, f) }
}

struct Suggestion(Option<&'static str>);

impl fmt::Display for Suggestion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.map_or(Ok(()), |near| write!(f, "; did you mean {near}?"))
    }
}

/// A setting that is accepted, but probably a mistake.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Warning {
    /// A gap below the specification's t3.5: a frame may be split, and devices may take two for one.
    GapBelowSpecification {
        /// The port.
        port: Name,
        /// Its gap.
        gap: Duration,
        /// The specification's t3.5 at this speed.
        t3_5: Duration,
    },
    /// Rules that no request reaches.
    NeverMatch {
        /// The rules.
        rules: Rules,
        /// The rules above that match all their requests; empty if their units have another meaning at their port.
        takers: Rules,
    },
    /// Units that a rule sends to a port without a server for them.
    NoServer {
        /// The rule.
        rule: Rules,
        /// The first of the units, by the port's numbering.
        unit: u8,
        /// The port.
        port: Name,
    },
    /// A request that a rule sends to one of the gateway's own servers, and that reaches the same rule again, endlessly.
    Circle {
        /// The rule.
        rule: Rules,
        /// A unit for which that happens.
        unit: u8,
        /// The server.
        port: Name,
    },
    /// A web interface that is off.
    #[cfg(feature = "web")]
    NobodyLogsIn {
        /// The port.
        port: Name,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::GapBelowSpecification { port, gap, t3_5 } => {
                write!(f, "port {port}: gap {} is below the specification's {}", Time(*gap), Time(*t3_5))
            }
            Self::NeverMatch { rules, takers } => {
                write!(f, "{rules} never {}: ", rules.verb("matches", "match"))?;
                let its = rules.verb("its", "their");
                if *takers == Rules::default() {
                    return write!(f, "{its} units mean something else at {its} port");
                }
                write!(f, "{takers} {} all {its} requests", takers.verb("takes", "take"))
            }
            Self::NoServer { rule, unit, port } => {
                write!(f, "{rule} leads to unit {unit} of port {port}, which has no server line: 0A")
            }
            Self::Circle { rule, unit, port } => {
                write!(f, "{rule} leads unit {unit} in a circle: its requests come back by port {port}")
            }
            #[cfg(feature = "web")]
            Self::NobodyLogsIn { port } => {
                write!(
                    f,
                    "port {port} is off until somebody can log in: user NAME role engineer, then password NAME"
                )
            }
        }
    }
}
