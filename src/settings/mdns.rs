//! How a gateway is found on the network: by multicast DNS (RFC 6762), with its Modbus TCP servers (RFC 6763).

use crate::settings::HostName;

/// Whether the gateway can be found, and by which name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mdns {
    /// It answers.
    On {
        /// The name of the gateway; when empty, the one that the board tells its DHCP server, or else the machine's.
        name: HostName,
    },
    /// It is silent.
    Off,
}

impl Mdns {
    /// What a gateway starts with.
    pub const DEFAULT: Self = Self::On { name: HostName::new() };
}

impl Default for Mdns {
    fn default() -> Self {
        Self::DEFAULT
    }
}
