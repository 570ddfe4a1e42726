//! The kinds of port in port lines: the start of the line, its keywords, its help, and how it is printed. An image lacks the words
//! and texts of features that it lacks.

use core::fmt::{self, Display};

use super::ethercat::ETHERCAT;
use super::listed::{joined, listed};
#[cfg(feature = "web")]
use super::port_keys::HTTP;
// As its ports.
#[cfg(feature = "dial-in")]
use super::port_keys::TCP_DIAL_IN;
use super::port_keys::{Keys, Keywords, NONE, SERIAL, SSH_SERVER, TCP_CLIENT, TCP_SERVER, UDP_SERVER};
use super::port_values::{device, server_address};
use super::problem::Problem;
use super::values::{listen, parse_number};
use super::words::{Word, Words, Wrong};
use crate::scanner::POINTS;
#[cfg(feature = "web")]
use crate::settings::HttpSettings;
use crate::settings::{
    EthercatSettings, Framing, MODBUS_TCP_PORT, PortKind, SERVERS, SerialSettings, Side, TcpClientSettings,
    TcpServerSettings, UdpServerSettings,
};

/// The medium of a port.
#[derive(Clone, Copy)]
pub(super) enum Medium {
    Serial,
    Tcp,
    Udp,
    #[cfg(feature = "web")]
    Http,
    Scanner,
    Ethercat,
    #[cfg(feature = "ssh")]
    Ssh,
}

/// The words for kinds of port.
pub(super) const MEDIA: &[(&str, Medium)] = &[
    ("serial", Medium::Serial),
    ("tcp", Medium::Tcp),
    ("udp", Medium::Udp),
    #[cfg(feature = "web")]
    ("http", Medium::Http),
    ("scanner", Medium::Scanner),
    ("ethercat", Medium::Ethercat),
    #[cfg(feature = "ssh")]
    ("ssh", Medium::Ssh),
];

const SIDES: &[(&str, Side)] =
    &[("server", Side::Server), ("slave", Side::Server), ("client", Side::Client), ("master", Side::Client)];

/// Parses the kind of a new port, up to the device or address.
pub(crate) fn new_port<'a>(words: &'a Words) -> Result<(PortKind, Word<'a>), Wrong> {
    let word = words.take();
    let medium = word.keyword(MEDIA, listed!(MEDIA))?;
    let side = match medium {
        Medium::Tcp => words.take().keyword(SIDES, "server or client")?,
        Medium::Udp => words.take().keyword(SIDES.get(..2).unwrap_or(SIDES), "server")?,
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
    if matches!((medium, side), (Medium::Tcp, Side::Client)) && words.peek().is("listen") {
        return listening(words);
    }
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
        #[cfg(feature = "web")]
        (Medium::Http, _) => PortKind::Http(HttpSettings::new(listen(endpoint)?)),
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

/// `listen 5020`, of a client whose device connects.
fn listening<'a>(words: &'a Words) -> Result<(PortKind, Word<'a>), Wrong> {
    let _word = words.take();
    // Other images have no such ports.
    #[cfg(not(feature = "dial-in"))]
    return Err(_word.expected("the address of a server: no device connects to this board"));
    #[cfg(feature = "dial-in")]
    {
        let endpoint = words.take();
        Ok((PortKind::TcpClient(TcpClientSettings::listening(listen(endpoint)?)), endpoint))
    }
}

/// The keywords of all kinds.
pub(super) const KEYS: &[Keys] = &[
    SERIAL.0,
    TCP_SERVER.0,
    TCP_CLIENT.0,
    // Other images have no such ports; also below.
    #[cfg(feature = "dial-in")]
    TCP_DIAL_IN.0,
    UDP_SERVER.0,
    #[cfg(feature = "web")]
    HTTP.0,
    ETHERCAT.0,
];

/// The lines of `help port` on how the line of each kind begins.
pub(super) const HELP: &str = joined!(&[
    "port NAME serial DEVICE rtu|ascii client|server [BAUD] [FORMAT] [OPTION]...
port NAME tcp|udp server [ADDRESS:]PORT [OPTION]...
port NAME tcp client ADDRESS[:PORT] [OPTION]...\tone server
",
    #[cfg(feature = "servers")]
    "port NAME tcp client [OPTION]...\tmany servers: see help server\n",
    #[cfg(feature = "dial-in")]
    "port NAME tcp client listen [ADDRESS:]PORT [OPTION]...\tits device connects\n",
    #[cfg(feature = "web")]
    "port NAME http server [ADDRESS:]PORT [OPTION]...\tthe web interface\n",
    #[cfg(feature = "ssh")]
    "port NAME ssh server [ADDRESS:]PORT [OPTION]...\tthe console by SSH\n",
    #[cfg(feature = "points")]
    "port NAME scanner\tpolls the devices of data points, by the
\trules for its name
port NAME ethercat [OPTION]...\tthe gateway as an EtherCAT SubDevice
",
]);

/// The lines of `help port` on the options of each kind.
pub(super) const HELP_OPTIONS: &str = joined!(&[
    "  serial:     19200 8E1 (ascii 7E1), gap T|auto, char-timeout T|auto,
              echo|no-echo, rs232|rs485|rts;
              with rs485 or rts: driver-before T, driver-after T
    client:   timeout T, retries N, turnaround T, start-delay T,
              late-window T|auto, down-after N, proof ...
    server:   answer-within T, reply-delay T
  tcp client: rtu, in-flight N, timeout T, connect-timeout T, connect-delay T,
              request-delay T, idle T, retries N, late-window T|auto,
              down-after N
    one server: unit N
",
    #[cfg(feature = "servers")]
    "    many servers: sockets N (connections at a time)\n",
    #[cfg(feature = "dial-in")]
    "    listen: unit N, allow PREFIX,...|*, first \"TEXT\"|0xBYTES\n",
    "  tcp server: rtu, clients N, idle T, pipeline N, lifetime T,
              full displace|refuse, reserve N for PREFIX[,PREFIX]...,
              allow PREFIX,...|*; capture: frames for Wireshark
  udp server: pipeline N, requests N, lifetime T, allow PREFIX,...|*
",
    #[cfg(feature = "web")]
    "  http server: allow PREFIX,...|*, cleartext (log in from other machines),
              metrics (without a log-in)
",
    #[cfg(feature = "points")]
    "  ethercat:   interface NAME (on Linux: where a MainDevice is),
              line PORT, on-loss hold|clear|stop, id N|alias,
              modules|no-modules, emergencies|no-emergencies,
",
    #[cfg(feature = "files")]
    "              files off|read|write (settings, log, capture by FoE),
",
    #[cfg(feature = "eoe")]
    "              ethernet NAME|none (a TAP interface for TCP/IP by EoE),
",
    #[cfg(feature = "points")]
    "              prove-outputs|no-prove-outputs
",
]);

/// Receives a port's role, its device or address, and the settings of its line or stream.
type Description<'d> = dyn FnMut(&dyn Display, &dyn Display, &dyn Display) + 'd;

impl PortKind {
    /// The keywords of this kind of port, and their list for errors.
    pub(crate) fn words(&self) -> Keywords {
        match self {
            Self::Serial(_) => SERIAL,
            Self::TcpServer(server) if server.is_ssh() => SSH_SERVER,
            Self::TcpServer(_) => TCP_SERVER,
            #[cfg(feature = "dial-in")]
            Self::TcpClient(client) if client.listens().is_some() => TCP_DIAL_IN,
            Self::TcpClient(_) => TCP_CLIENT,
            Self::UdpServer(_) => UDP_SERVER,
            Self::Ethercat(_) => ETHERCAT,
            Self::Scanner => NONE,
            #[cfg(feature = "web")]
            Self::Http(_) => HTTP,
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
            Self::TcpClient(settings) => match (&settings.server, settings.listens()) {
                (Some(server), _) => write!(f, "tcp client {server}"),
                (None, Some(listen)) => write!(f, "tcp client listen {listen}"),
                (None, None) => f.write_str("tcp client"),
            },
            Self::UdpServer(settings) => write!(f, "udp server {}", settings.listen),
            #[cfg(feature = "web")]
            Self::Http(HttpSettings { listen, .. }) => write!(f, "http server {listen}"),
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
            Self::TcpClient(client) => {
                let TcpClientSettings { server, framing, .. } = client;
                match client.listens() {
                    Some(listen) => show(&"tcp client", &format_args!("listen {listen}"), framing),
                    None => {
                        let server: Option<&dyn Display> = server.as_ref().map(|server| server as _);
                        show(&"tcp client", server.unwrap_or(&"see show servers"), framing);
                    }
                }
            }
            Self::UdpServer(server) => show(&"udp server", &server.listen, &""),
            Self::Ethercat(EthercatSettings { interface, .. }) => {
                show(&"ethercat", interface.as_ref().map_or(&"", |name| name), &"");
            }
            #[cfg(feature = "web")]
            Self::Http(server) => {
                let how = match server.cleartext {
                    _ if server.is_encrypted() => "tls",
                    true => "cleartext",
                    false => "",
                };
                show(&"http server", &server.listen, &how);
            }
            Self::Scanner => show(&"scanner", &"", &""),
        }
    }
}
