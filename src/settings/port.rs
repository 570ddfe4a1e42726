//! A port: its name, its kind, and what special unit ids mean there.

use crate::settings::{
    EthercatSettings, Name, SerialSettings, Side, TcpClientSettings, TcpServerSettings, UdpServerSettings,
};

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
