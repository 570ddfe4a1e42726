//! A port: its name, its kind, and the meaning of special unit ids.

// As the variant.
#[cfg(feature = "web")]
use crate::settings::Allowed;
// As what returns it.
#[cfg(feature = "tls")]
use crate::settings::TlsSettings;
use crate::settings::{
    EthercatSettings, Name, SerialSettings, Side, TcpClientSettings, TcpListen, TcpServerSettings,
    UdpServerSettings,
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

/// The meaning of unit ids that do not belong to a device: 0 is the broadcast, 248 to 255 are reserved (Serial Line 2.2), and 255
/// is the TCP device itself (Messaging on TCP/IP 4.4.1.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct UnitPolicy {
    /// Unit 0.
    pub broadcast: Special,
    /// Broadcast writes from TCP clients are confirmed like a write to one device.
    pub confirm: bool,
    /// Unit 255.
    pub unit_255: Special,
    /// Units 248 to 254.
    pub reserved: Special,
}

impl UnitPolicy {
    /// The meaning of `unit`.
    pub const fn of(&self, unit: u8) -> Special {
        match unit {
            0 => self.broadcast,
            248..=254 => self.reserved,
            255 => self.unit_255,
            _ => Special::Rules,
        }
    }
}

/// The meaning of a special unit id.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Special {
    /// The rules decide, as for other units.
    #[default]
    Rules,
    /// No unit: 0Ah to a TCP client, silence on a serial line.
    Off,
    /// The gateway's own unit.
    Local,
    /// Replaced by this unit, for which the rules decide.
    Replace(u8),
    /// Every serial line that the rules of this port lead to; unit 0 only.
    AllLines,
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
    // Images without it have no word of it.
    #[cfg(feature = "web")]
    Http {
        /// Where it listens.
        listen: TcpListen,
        /// Peers that may connect; others are disconnected at once.
        allowed: Allowed,
        /// Whether users may log in from other machines without encryption.
        cleartext: bool,
    },
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
    // Images without TLS have no word of it.
    #[cfg(feature = "tls")]
    pub fn tls(&self) -> Option<&TlsSettings> {
        let tls = match self {
            Self::TcpServer(server) => &server.tls,
            Self::TcpClient(client) => &client.tls,
            _ => return None,
        };
        tls.on.then_some(tls)
    }

    /// Whether its clients may have roles.
    pub(crate) fn has_roles(&self) -> bool {
        // As above.
        #[cfg(feature = "tls")]
        return self.side() == Side::Server && self.tls().is_some();
        #[cfg(not(feature = "tls"))] // As above.
        false
    }

    /// Number of connections it needs: one per client, and one to accept newcomers.
    pub(crate) fn connections(&self) -> usize {
        match self {
            Self::TcpServer(server) => usize::from(server.clients) + 1,
            _ => 0,
        }
    }

    /// Where it listens for TCP connections, if it does.
    pub(crate) const fn tcp_listen(&self) -> Option<&TcpListen> {
        match self {
            Self::TcpServer(server) => Some(&server.listen),
            // As the variant.
            #[cfg(feature = "web")]
            Self::Http { listen, .. } => Some(listen),
            _ => None,
        }
    }

    /// Whether its clients send requests to units.
    pub(crate) const fn has_units(&self) -> bool {
        match self {
            // As the variant.
            #[cfg(feature = "web")]
            Self::Http { .. } => false,
            Self::TcpServer(server) => !server.is_ssh(),
            _ => true,
        }
    }
}
