//! Discovery by multicast DNS (RFC 6762), with the Modbus TCP servers as services (RFC 6763).

use crate::settings::HostName;

/// Whether the gateway announces itself, and under which name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mdns {
    /// It announces itself.
    On {
        /// The name; if empty, the board's DHCP name, or else the machine's name.
        name: HostName,
    },
    /// It does not announce itself.
    Off,
}

impl Mdns {
    /// The default.
    pub const DEFAULT: Self = Self::On { name: HostName::new() };
}

impl Default for Mdns {
    fn default() -> Self {
        Self::DEFAULT
    }
}
