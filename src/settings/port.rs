//! A port: its name and its kind, with the settings of each kind by their keys.

use strum::{EnumCount, EnumDiscriminants};

// As the variant.
#[cfg(feature = "web")]
use crate::settings::HttpSettings;
// As what uses it.
#[cfg(feature = "tls")]
use crate::settings::TlsSettings;
use crate::settings::{
    DIAL_IN_WAITING_MAX, Driver, EthercatSettings, Field, Framing, Name, SerialSettings, Side, StreamFraming,
    TcpClientSettings, TcpListen, TcpServerSettings, UdpServerSettings, UnitPolicy,
};

/// One port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Port {
    /// Unique, without regard to case.
    pub name: Name,
    /// Its kind, with the settings.
    pub kind: PortKind,
    /// The meaning of special unit ids, for a server-side port.
    pub units: UnitPolicy,
}

/// The kinds of port.
// Stored in a table without a heap; on hosts a serial device's name makes one variant much larger.
#[cfg_attr(feature = "paths", allow(clippy::large_enum_variant))]
#[derive(Debug, Clone, PartialEq, Eq)]
// With a tag of its own: one in the gaps of the largest variant takes more code at each match.
#[repr(u8)]
pub enum PortKind {
    /// An RS-485 or RS-232 line.
    Serial(SerialSettings),
    /// A listener for Modbus TCP clients.
    TcpServer(TcpServerSettings),
    /// A device behind Modbus TCP, or RTU over TCP.
    TcpClient(TcpClientSettings),
    /// A listener for Modbus UDP clients.
    UdpServer(UdpServerSettings),
    /// Polls the devices of data points.
    Scanner,
    /// Polls the devices of the EtherCAT process image.
    Ethercat(EthercatSettings),
    /// The web interface.
    // Left out of images without it.
    #[cfg(feature = "web")]
    Http(HttpSettings),
}

impl PortKind {
    /// The side of the protocol that the port is on.
    pub const fn side(&self) -> Side {
        match self {
            Self::Serial(settings) => settings.side,
            Self::TcpClient(_) => Side::Client,
            _ => Side::Server,
        }
    }

    /// Whether the port sends its own requests instead of an outside client's.
    pub(crate) const fn asks_by_itself(&self) -> bool {
        matches!(self, Self::Scanner | Self::Ethercat(_))
    }

    /// Whether clients of this port have an IP address.
    pub(crate) const fn has_peers(&self) -> bool {
        !matches!(self, Self::Serial(_) | Self::Scanner | Self::Ethercat(_))
    }

    /// The certificates, if the port speaks TLS.
    // Left out of images without TLS.
    #[cfg(feature = "tls")]
    pub(crate) fn tls(&self) -> Option<&TlsSettings> {
        let tls = match self {
            Self::TcpServer(server) => &server.tls,
            Self::TcpClient(client) => &client.tls,
            // As the variant.
            #[cfg(feature = "web")]
            Self::Http(server) => &server.tls,
            _ => return None,
        };
        tls.on.then_some(tls)
    }

    /// Whether, as a server with TLS, it serves only clients that show a certificate.
    #[cfg(feature = "tls")]
    pub fn wants_certificates(&self) -> bool {
        match self {
            // As the variant.
            #[cfg(feature = "web")]
            Self::Http(server) => server.tls.trust.is_some(),
            _ => self.side() == Side::Server,
        }
    }

    /// Whether its clients may have roles.
    pub(crate) fn has_roles(&self) -> bool {
        #[cfg(feature = "tls")]
        return matches!(self, Self::TcpServer(server) if server.tls.on);
        #[cfg(not(feature = "tls"))]
        false
    }

    /// Number of connections it needs: one per client, or per device that has just connected, and one to accept newcomers.
    pub(crate) fn connections(&self) -> usize {
        match self {
            Self::TcpServer(server) => usize::from(server.clients) + 1,
            Self::TcpClient(client) if client.listens().is_some() => DIAL_IN_WAITING_MAX + 1,
            _ => 0,
        }
    }

    /// Where it listens for TCP connections, if it does.
    pub(crate) const fn tcp_listen(&self) -> Option<&TcpListen> {
        match self {
            Self::TcpServer(server) => Some(&server.listen),
            Self::TcpClient(client) => client.listens(),
            // As the variant.
            #[cfg(feature = "web")]
            Self::Http(server) => Some(&server.listen),
            _ => None,
        }
    }

    /// Whether its clients send requests to units.
    pub(crate) const fn has_units(&self) -> bool {
        match self {
            // As the variant.
            #[cfg(feature = "web")]
            Self::Http(_) => false,
            Self::TcpServer(server) => !server.is_ssh(),
            _ => true,
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
            #[cfg(feature = "web")]
            Self::Http(settings) => settings.field(key),
        }
    }

    /// The same port with default settings, except for a serial port's framing and side.
    pub(crate) fn plain(&self) -> Self {
        match self {
            Self::Serial(settings) => Self::Serial(settings.plain()),
            Self::TcpServer(settings) => Self::TcpServer(settings.plain()),
            Self::TcpClient(settings) => Self::TcpClient(settings.plain()),
            Self::UdpServer(settings) => Self::UdpServer(UdpServerSettings::new(settings.listen)),
            #[cfg(feature = "web")]
            Self::Http(server) => Self::Http(HttpSettings::new(server.listen)),
            Self::Scanner => Self::Scanner,
            // Never the other one: where there is no EtherCAT, there is no such port.
            Self::Ethercat(_) => EthercatSettings::new().map_or(Self::Scanner, Self::Ethercat),
        }
    }
}

/// The setting that a keyword of a port line changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumDiscriminants)]
#[strum_discriminants(name(KeyName), derive(EnumCount))]
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
    // Left out of images in which no device connects.
    #[cfg(feature = "dial-in")]
    First,
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
    // Left out of images without files.
    #[cfg(feature = "files")]
    Files,
    // Likewise without Ethernet for a MainDevice.
    #[cfg(feature = "eoe")]
    Ethernet,
    // Left out of images without TLS; also below.
    #[cfg(feature = "tls")]
    Tls(bool),
    #[cfg(feature = "tls")]
    Certificate,
    #[cfg(feature = "tls")]
    Trust,
    // Left out of images without a web interface.
    #[cfg(feature = "web")]
    Cleartext(bool),
    #[cfg(feature = "web")]
    Metrics(bool),
}

impl Key {
    /// The bit that records that a line has set it.
    pub(crate) fn bit(self) -> u64 {
        1 << KeyName::from(self) as u64
    }
}

const _: () = assert!(KeyName::COUNT <= u64::BITS as usize, "there is a bit for each key");
