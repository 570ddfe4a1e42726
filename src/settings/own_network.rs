//! How a board gets its own address.

use core::net::Ipv4Addr;

use heapless::String;

/// Longest host name in bytes.
pub const HOST_NAME_BYTES_MAX: usize = 32;

/// A host name, as sent to a DHCP server.
pub type HostName = String<HOST_NAME_BYTES_MAX, u8>;

/// How the board gets its address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum OwnNetwork {
    /// By DHCP.
    Dhcp {
        /// The host name sent to the server; none if empty.
        name: HostName,
    },
    /// A static address.
    Static(StaticAddress),
}

/// A static address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StaticAddress {
    /// The board's address.
    pub address: Ipv4Addr,
    /// Leading bits that the hosts of its network have in common, 1 to 30.
    pub prefix: u8,
    /// The default gateway.
    pub gateway: Option<Ipv4Addr>,
    /// The DNS server.
    pub dns: Option<Ipv4Addr>,
}

impl OwnNetwork {
    /// The default.
    pub const DEFAULT: Self = Self::Dhcp { name: String::new() };
}

impl Default for OwnNetwork {
    fn default() -> Self {
        Self::DEFAULT
    }
}
