//! The kinds of port in port lines: the start of the line, the keywords and their settings, and the list for errors.

use core::fmt::{self, Display};

use super::field::Field;
use super::port_keys::{Key, Keys, Keywords, UNIT_KEYS};
use super::port_limits::{
    BAUD, CHAR_TIMEOUT, CLIENTS, DOWN_AFTER, HOUR, ID, IDLE, LIFETIME, MINUTE, PIPELINE, REQUESTS, RESERVED,
    RETRIES, SECOND, SOCKETS, TEN_SECONDS, TIMEOUT, UNIT,
};
use super::port_values::{device, server_address};
use super::problem::Problem;
use super::values::{listen, parse_number};
use super::words::{Word, Words, Wrong};
use crate::scanner::POINTS;
use crate::settings::{
    Driver, EthercatSettings, Framing, MODBUS_TCP_PORT, PortKind, SERVERS, SerialSettings, Side,
    StreamFraming, TcpClientSettings, TcpServerSettings, UdpServerSettings,
};

/// The medium of a port.
#[derive(Clone, Copy)]
enum Medium {
    Serial,
    Tcp,
    Udp,
    Scanner,
    Ethercat,
}

const MEDIA: [(&str, Medium); 5] = [
    ("serial", Medium::Serial),
    ("tcp", Medium::Tcp),
    ("udp", Medium::Udp),
    ("scanner", Medium::Scanner),
    ("ethercat", Medium::Ethercat),
];

const SIDES: &[(&str, Side)] =
    &[("server", Side::Server), ("slave", Side::Server), ("client", Side::Client), ("master", Side::Client)];

/// Whether the word is a kind of port where the port's name is expected.
pub(crate) fn is_kind(word: Word) -> bool {
    word.lookup(&MEDIA).is_some()
}

const SERIAL: Keywords = (
    &[
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
    ],
    "rtu, ascii, client, server, a baud rate, a format (8E1), device, timeout, char-timeout, gap, rs485, rts, \
     driver-before, driver-after, echo, retries, turnaround, start-delay, late-window, \
     down-after, proof, answer-within or reply-delay",
);

const TCP_SERVER: Keywords = (
    &[
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
    ],
    "listen, rtu, capture, clients, idle, pipeline, lifetime, full, reserve or allow",
);

const TCP_CLIENT: Keywords = (
    &[
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
    ],
    "address, rtu, sockets, unit, in-flight, timeout, connect-timeout, \
     connect-delay, request-delay, idle, retries, late-window, down-after or proof",
);

const UDP_SERVER: Keywords = (
    &[
        ("listen", Key::Listen),
        ("pipeline", Key::Pipeline),
        ("requests", Key::Requests),
        ("lifetime", Key::Lifetime),
        ("allow", Key::Allow),
    ],
    "listen, pipeline, requests, lifetime or allow",
);

const NONE: Keywords = (&[], "");
const ETHERCAT: Keywords = if POINTS { WITH_CONTROLLER } else { NONE };
const WITH_CONTROLLER: Keywords = (
    &[
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
    ],
    "interface, line, on-loss, id, modules, emergencies or prove-outputs",
);

/// Parses the kind of a new port, up to the device or address.
pub(crate) fn new_port<'a>(words: &'a Words) -> Result<(PortKind, Word<'a>), Wrong> {
    let word = words.take();
    let medium = word.keyword(&MEDIA, "serial, tcp, udp, scanner or ethercat")?;
    let side = match medium {
        Medium::Tcp => words.take().keyword(SIDES, "server or client")?,
        Medium::Udp => words.take().keyword(SIDES.get(..2).unwrap_or(SIDES), "server")?,
        Medium::Scanner | Medium::Ethercat if !POINTS => return Err(word.error(Problem::NoPoints)),
        Medium::Scanner => {
            words.end()?;
            return Ok((PortKind::Scanner, word));
        }
        Medium::Ethercat => return Ok((PortKind::Ethercat(EthercatSettings::default()), word)),
        Medium::Serial => Side::Client,
    };
    if SERVERS && matches!((medium, side), (Medium::Tcp, Side::Client)) {
        // A keyword is not a server's name.
        let next = words.peek();
        if next.is_end() || next.lookup(TCP_CLIENT.0).is_some() {
            return Ok((PortKind::TcpClient(TcpClientSettings::new(None)), word));
        }
    }
    let endpoint = words.take();
    let kind = match (medium, side) {
        (Medium::Tcp, Side::Server) => {
            let listen = listen(endpoint)?;
            PortKind::TcpServer(TcpServerSettings { listen, ..TcpServerSettings::new(listen.port) })
        }
        (Medium::Tcp, Side::Client) => {
            PortKind::TcpClient(TcpClientSettings::new(Some(server_address(endpoint, MODBUS_TCP_PORT)?)))
        }
        (Medium::Udp, _) => PortKind::UdpServer(UdpServerSettings::new(listen(endpoint)?)),
        // A keyword or number of a serial line is not a device name.
        _ if endpoint.lookup(SERIAL.0).is_some() || parse_number(endpoint.text).is_some() => {
            let device_first =
                "the device, which comes first: port NAME serial DEVICE rtu|ascii client|server";
            return Err(endpoint.error(Problem::TakenAs(device_first)));
        }
        _ => PortKind::Serial(SerialSettings::new(device(endpoint)?)),
    };
    Ok((kind, endpoint))
}

/// Calls `each` with the keywords of all ports.
pub(crate) fn keywords(each: &mut dyn FnMut(&'static str)) {
    MEDIA.iter().for_each(|&(keyword, _)| each(keyword));
    let tables = [SERIAL.0, TCP_SERVER.0, TCP_CLIENT.0, UDP_SERVER.0, ETHERCAT.0, UNIT_KEYS];
    for (nth, table) in tables.into_iter().enumerate() {
        for &(keyword, _) in table {
            // Several kinds have a `timeout`: it is offered once.
            let is_known = |earlier: Keys| earlier.iter().any(|(known, _)| *known == keyword);
            if !tables.into_iter().take(nth).any(is_known) {
                each(keyword);
            }
        }
    }
}

/// Receives a port's role, its device or address, and the settings of its line or stream.
type Description<'d> = dyn FnMut(&dyn Display, &dyn Display, &dyn Display) + 'd;

impl PortKind {
    /// The keywords of this kind of port, and their list for errors.
    pub(crate) const fn words(&self) -> Keywords {
        match self {
            Self::Serial(_) => SERIAL,
            Self::TcpServer(_) => TCP_SERVER,
            Self::TcpClient(_) => TCP_CLIENT,
            Self::UdpServer(_) => UDP_SERVER,
            Self::Ethercat(_) => ETHERCAT,
            Self::Scanner => NONE,
        }
    }

    /// The field that `key` sets; `None` if this kind of port has no such setting.
    pub(crate) fn field(&mut self, key: Key) -> Option<Field<'_>> {
        match self {
            Self::Serial(settings) => settings.field(key),
            Self::TcpServer(settings) => settings.field(key),
            Self::TcpClient(settings) => settings.field(key),
            Self::UdpServer(settings) => settings.field(key),
            Self::Ethercat(settings) => settings.field(key),
            Self::Scanner => None,
        }
    }

    /// Writes the start of the port's line, after its name.
    pub(crate) fn write_begin(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(SerialSettings { device, framing, side, line, .. }) => {
                write!(f, "serial {device} {framing} {side} {}", line.speed())
            }
            Self::TcpServer(settings) => write!(f, "tcp server {}", settings.listen),
            Self::TcpClient(settings) => match &settings.server {
                Some(server) => write!(f, "tcp client {server}"),
                None => f.write_str("tcp client"),
            },
            Self::UdpServer(settings) => write!(f, "udp server {}", settings.listen),
            Self::Scanner => f.write_str("scanner"),
            Self::Ethercat(_) => f.write_str("ethercat"),
        }
    }

    /// Passes a description of the port to `show`.
    pub(crate) fn describe(&self, show: &mut Description<'_>) {
        match self {
            Self::Serial(SerialSettings { device, framing, side, line, .. }) => {
                let role = match (framing, side) {
                    (Framing::Rtu, Side::Client) => "rtu client",
                    (Framing::Rtu, Side::Server) => "rtu server",
                    (Framing::Ascii, Side::Client) => "ascii client",
                    (Framing::Ascii, Side::Server) => "ascii server",
                };
                show(&role, device, &line.speed());
            }
            Self::TcpServer(server) => show(&"tcp server", &server.listen, &server.framing),
            Self::TcpClient(TcpClientSettings { server, framing, .. }) => {
                show(&"tcp client", server.as_ref().map_or(&"see show servers", |server| server), framing);
            }
            Self::UdpServer(server) => show(&"udp server", &server.listen, &""),
            Self::Ethercat(EthercatSettings { interface, .. }) => {
                show(&"ethercat", interface.as_ref().map_or(&"", |name| name), &"");
            }
            Self::Scanner => show(&"scanner", &"", &""),
        }
    }

    /// The same port with default settings, except for a serial port's framing and side.
    pub(crate) fn plain(&self) -> Self {
        match self {
            Self::Serial(SerialSettings { device, framing, side, .. }) => {
                let plain = SerialSettings::new(device.clone());
                Self::Serial(SerialSettings { framing: *framing, side: *side, ..plain })
            }
            Self::TcpServer(settings) => {
                let mut plain = TcpServerSettings::new(settings.listen.port);
                plain.listen = settings.listen;
                plain.clients = plain.clients_of(settings.framing);
                Self::TcpServer(plain)
            }
            Self::TcpClient(settings) => Self::TcpClient(TcpClientSettings::new(settings.server.clone())),
            Self::UdpServer(settings) => Self::UdpServer(UdpServerSettings::new(settings.listen)),
            Self::Scanner => Self::Scanner,
            Self::Ethercat(_) => Self::Ethercat(EthercatSettings::default()),
        }
    }
}

impl SerialSettings {
    fn field(&mut self, key: Key) -> Option<Field<'_>> {
        let Self { line, client, server, .. } = self;
        Some(match key {
            Key::Device => Field::Device(&mut self.device),
            Key::Framing(framing) => Field::Framing(&mut self.framing, framing),
            Key::Side(side) => Field::Side(&mut self.side, side),
            Key::Baud => Field::Baud(&mut line.baud, &BAUD),
            Key::Format => Field::Format(line),
            Key::Gap => Field::AutoTime(&mut line.gap, &SECOND),
            Key::CharTimeout => Field::AutoTime(&mut line.char_timeout, &CHAR_TIMEOUT),
            Key::Driver(driver) => Field::Driver(&mut line.driver, driver),
            Key::DriverBefore => Field::Time(&mut line.driver_before, &SECOND),
            Key::DriverAfter => Field::Time(&mut line.driver_after, &SECOND),
            Key::Echo(echo) => Field::Flag(&mut line.echo, echo),
            Key::AnswerWithin => Field::Time(&mut server.answer_within, &LIFETIME),
            Key::ReplyDelay => Field::Time(&mut server.reply_delay, &TEN_SECONDS),
            Key::Timeout => Field::Time(&mut client.timeout, &TIMEOUT),
            Key::Retries => Field::Small(&mut client.retries, &RETRIES),
            Key::Turnaround => Field::Time(&mut client.turnaround, &MINUTE),
            Key::StartDelay => Field::Time(&mut client.start_delay, &HOUR),
            Key::LateWindow => Field::AutoTime(&mut client.late_window, &HOUR),
            Key::DownAfter => Field::Small(&mut client.down_after, &DOWN_AFTER),
            Key::Proof => Field::Proofs(&mut client.proofs),
            _ => return None,
        })
    }
}

impl TcpServerSettings {
    fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Listen => Field::Listen(&mut self.listen),
            Key::Stream(framing) => Field::Stream(&mut self.framing, framing),
            Key::Clients => Field::Medium(&mut self.clients, &CLIENTS),
            Key::Idle => Field::Idle(&mut self.idle, &IDLE),
            Key::Pipeline => Field::Small(&mut self.pipeline, &PIPELINE),
            Key::Lifetime => Field::Time(&mut self.lifetime, &LIFETIME),
            Key::Full => Field::Full(&mut self.refuses),
            Key::Reserve => Field::Reserve(&mut self.reserved, &mut self.reserved_for, &RESERVED),
            Key::Allow => Field::Allow(&mut self.allowed),
            _ => return None,
        })
    }
}

impl TcpClientSettings {
    fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Server => Field::Server(&mut self.server),
            Key::Stream(framing) => Field::Stream(&mut self.framing, framing),
            Key::Unit => Field::Unit(&mut self.unit, &UNIT),
            Key::Sockets => Field::Small(&mut self.sockets, &SOCKETS),
            Key::InFlight => Field::Small(&mut self.in_flight, &PIPELINE),
            Key::Timeout => Field::Time(&mut self.timeout, &TIMEOUT),
            Key::ConnectTimeout => Field::Time(&mut self.connect_timeout, &TIMEOUT),
            Key::ConnectDelay => Field::Time(&mut self.connect_delay, &MINUTE),
            Key::RequestDelay => Field::Time(&mut self.request_delay, &MINUTE),
            Key::Idle => Field::Idle(&mut self.idle, &IDLE),
            Key::Retries => Field::Small(&mut self.retries, &RETRIES),
            Key::LateWindow => Field::AutoTime(&mut self.late_window, &HOUR),
            Key::DownAfter => Field::Small(&mut self.down_after, &DOWN_AFTER),
            Key::Proof => Field::Proofs(&mut self.proofs),
            _ => return None,
        })
    }
}

impl UdpServerSettings {
    fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Listen => Field::Listen(&mut self.listen),
            Key::Pipeline => Field::Small(&mut self.pipeline, &PIPELINE),
            Key::Requests => Field::Small(&mut self.requests, &REQUESTS),
            Key::Lifetime => Field::Time(&mut self.lifetime, &LIFETIME),
            Key::Allow => Field::Allow(&mut self.allowed),
            _ => return None,
        })
    }
}

impl EthercatSettings {
    fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            // Its keywords exist only in images with points.
            _ if !POINTS => return None,
            Key::Interface => Field::Interface(&mut self.interface),
            Key::Line => Field::Line(&mut self.line),
            Key::OnLoss => Field::OnLoss(&mut self.on_loss),
            Key::ProveOutputs(prove) => Field::Flag(&mut self.prove_outputs, prove),
            Key::Emergencies(sent) => Field::Flag(&mut self.emergencies, sent),
            Key::Modules(modules) => Field::Flag(&mut self.modules, modules),
            Key::Id => Field::Id(&mut self.id, &ID),
            _ => return None,
        })
    }
}
