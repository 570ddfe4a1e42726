//! The kinds of port in port lines: the start of the line, the fields that keywords set, and how they are printed.

use core::fmt::{self, Display};

use super::field::Field;
use super::listed::listed;
use super::port_keys::{Key, Keys, Keywords, UNIT_KEYS};
// As above.
#[cfg(feature = "web")]
use super::port_keywords::HTTP;
use super::port_keywords::{ETHERCAT, NONE, SERIAL, SSH_SERVER, TCP_CLIENT, TCP_SERVER, UDP_SERVER};
// As what uses them.
use super::port_values::{device, server_address};
use super::problem::Problem;
use super::values::{listen, parse_number};
use super::words::{Word, Words, Wrong};
#[cfg(feature = "web")]
use super::{
    port_limits::BAUD,
    shape::{KIND, Member, NAME, Shape},
};
use crate::scanner::POINTS;
// As above.
#[cfg(feature = "web")]
use crate::settings::Allowed;
use crate::settings::{
    EthercatSettings, Framing, MODBUS_TCP_PORT, PortKind, SERVERS, SerialSettings, Side, TcpClientSettings,
    TcpServerSettings, UdpServerSettings,
};

/// The medium of a port.
#[derive(Clone, Copy)]
enum Medium {
    Serial,
    Tcp,
    Udp,
    // Images without it have no word of it.
    #[cfg(feature = "web")]
    Http,
    Scanner,
    Ethercat,
    // Where there is none, its word is not known; also below.
    #[cfg(feature = "ssh")]
    Ssh,
}

const MEDIA: &[(&str, Medium)] = &[
    ("serial", Medium::Serial),
    ("tcp", Medium::Tcp),
    ("udp", Medium::Udp),
    #[cfg(feature = "web")] // As above.
    ("http", Medium::Http),
    ("scanner", Medium::Scanner),
    ("ethercat", Medium::Ethercat),
    #[cfg(feature = "ssh")]
    ("ssh", Medium::Ssh),
];
const MEDIA_EXPECTED: &str = listed!(MEDIA);

const SIDES: &[(&str, Side)] =
    &[("server", Side::Server), ("slave", Side::Server), ("client", Side::Client), ("master", Side::Client)];

/// Whether the word is a kind of port where the port's name is expected.
pub(crate) fn is_kind(word: Word) -> bool {
    word.lookup(MEDIA).is_some()
}

/// A kind of port for interfaces with settings by name: how its line begins behind the name, its columns, and the shortest line of it.
// Only the web interface has them.
#[cfg(feature = "web")]
pub(crate) type Line = (&'static str, &'static [Member], &'static str);

#[cfg(feature = "web")] // As above.
const LISTEN_COLUMNS: &[Member] = &[NAME, KIND, ("listen", Shape::Text)];

/// All kinds of port. What this image lacks is refused by [`new_port`].
#[cfg(feature = "web")] // As above.
pub(crate) const LINES: &[Line] = &[
    (
        "serial",
        &[
            NAME,
            KIND,
            ("device", Shape::Text),
            ("framing", Shape::Text),
            ("side", Shape::Text),
            ("baud", Shape::Number(*BAUD.start(), *BAUD.end())),
            ("format", Shape::Text),
        ],
        "serial -",
    ),
    ("tcp server", LISTEN_COLUMNS, "tcp server 1"),
    ("tcp client", &[NAME, KIND, ("address", Shape::Text)], "tcp client 127.0.0.1"),
    ("udp server", LISTEN_COLUMNS, "udp server 1"),
    ("http server", LISTEN_COLUMNS, "http server 1"),
    ("ssh server", LISTEN_COLUMNS, "ssh server 1"),
    ("ethercat", &[NAME, KIND], "ethercat"),
    ("scanner", &[NAME, KIND], "scanner"),
];

/// Parses the kind of a new port, up to the device or address.
pub(crate) fn new_port<'a>(words: &'a Words) -> Result<(PortKind, Word<'a>), Wrong> {
    let word = words.take();
    let medium = word.keyword(MEDIA, MEDIA_EXPECTED)?;
    let side = match medium {
        Medium::Tcp => words.take().keyword(SIDES, "server or client")?,
        Medium::Udp => words.take().keyword(SIDES.get(..2).unwrap_or(SIDES), "server")?,
        // As above.
        #[cfg(feature = "web")]
        Medium::Http => words.take().keyword(SIDES.get(..2).unwrap_or(SIDES), "server")?,
        #[cfg(feature = "ssh")]
        Medium::Ssh => words.take().keyword(SIDES.get(..1).unwrap_or(SIDES), "server")?,
        Medium::Scanner if POINTS => {
            words.end()?;
            return Ok((PortKind::Scanner, word));
        }
        Medium::Scanner | Medium::Ethercat => {
            let settings = EthercatSettings::new().ok_or_else(|| word.error(Problem::NoPoints))?;
            return Ok((PortKind::Ethercat(settings), word));
        }
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
        #[cfg(feature = "ssh")]
        (Medium::Ssh, _) => PortKind::TcpServer(TcpServerSettings::ssh(listen(endpoint)?)),
        (Medium::Tcp, Side::Client) => {
            PortKind::TcpClient(TcpClientSettings::new(Some(server_address(endpoint, MODBUS_TCP_PORT)?)))
        }
        (Medium::Udp, _) => PortKind::UdpServer(UdpServerSettings::new(listen(endpoint)?)),
        // As above.
        #[cfg(feature = "web")]
        (Medium::Http, _) => {
            PortKind::Http { listen: listen(endpoint)?, allowed: Allowed::everybody(), cleartext: false }
        }
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
    let tables = [
        SERIAL.0,
        TCP_SERVER.0,
        TCP_CLIENT.0,
        UDP_SERVER.0,
        #[cfg(feature = "web")] // As above.
        HTTP.0,
        ETHERCAT.0,
        UNIT_KEYS,
    ];
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
    pub(crate) fn words(&self) -> Keywords {
        match self {
            Self::Serial(_) => SERIAL,
            Self::TcpServer(server) if server.is_ssh() => SSH_SERVER,
            Self::TcpServer(_) => TCP_SERVER,
            Self::TcpClient(_) => TCP_CLIENT,
            Self::UdpServer(_) => UDP_SERVER,
            Self::Ethercat(_) => ETHERCAT,
            Self::Scanner => NONE,
            // As above.
            #[cfg(feature = "web")]
            Self::Http { .. } => HTTP,
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
            // As above.
            #[cfg(feature = "web")]
            Self::Http { listen, allowed, cleartext } => Some(match key {
                Key::Listen => Field::Listen(listen),
                Key::Allow => Field::Allow(allowed),
                Key::Cleartext(is_clear) => Field::Flag(cleartext, is_clear),
                _ => return None,
            }),
        }
    }

    /// Writes the start of the port's line, after its name.
    pub(crate) fn write_begin(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(SerialSettings { device, framing, side, line, .. }) => {
                write!(f, "serial {device} {framing} {side} {}", line.speed())
            }
            Self::TcpServer(server) if server.is_ssh() => write!(f, "ssh server {}", server.listen),
            Self::TcpServer(settings) => write!(f, "tcp server {}", settings.listen),
            Self::TcpClient(settings) => match &settings.server {
                Some(server) => write!(f, "tcp client {server}"),
                None => f.write_str("tcp client"),
            },
            Self::UdpServer(settings) => write!(f, "udp server {}", settings.listen),
            // As above.
            #[cfg(feature = "web")]
            Self::Http { listen, .. } => write!(f, "http server {listen}"),
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
            Self::TcpServer(server) if server.is_ssh() => show(&"ssh server", &server.listen, &""),
            Self::TcpServer(server) => show(&"tcp server", &server.listen, &server.framing),
            Self::TcpClient(TcpClientSettings { server, framing, .. }) => {
                show(&"tcp client", server.as_ref().map_or(&"see show servers", |server| server), framing);
            }
            Self::UdpServer(server) => show(&"udp server", &server.listen, &""),
            Self::Ethercat(EthercatSettings { interface, .. }) => {
                show(&"ethercat", interface.as_ref().map_or(&"", |name| name), &"");
            }
            // As above.
            #[cfg(feature = "web")]
            Self::Http { listen, cleartext, .. } => {
                show(&"http server", listen, &if *cleartext { "cleartext" } else { "" });
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
            Self::TcpServer(settings) if settings.is_ssh() => {
                Self::TcpServer(TcpServerSettings::ssh(settings.listen))
            }
            Self::TcpServer(settings) => {
                let mut plain = TcpServerSettings::new(settings.listen.port);
                plain.listen = settings.listen;
                plain.clients = plain.clients_of(settings.framing);
                Self::TcpServer(plain)
            }
            Self::TcpClient(settings) => Self::TcpClient(TcpClientSettings::new(settings.server.clone())),
            Self::UdpServer(settings) => Self::UdpServer(UdpServerSettings::new(settings.listen)),
            // As above.
            #[cfg(feature = "web")]
            Self::Http { listen, .. } => {
                Self::Http { listen: *listen, allowed: Allowed::everybody(), cleartext: false }
            }
            Self::Scanner => Self::Scanner,
            // Never the other one: where there is no EtherCAT, there is no such port.
            Self::Ethercat(_) => EthercatSettings::new().map_or(Self::Scanner, Self::Ethercat),
        }
    }
}
