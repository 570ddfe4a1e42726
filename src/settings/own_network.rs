//! How a board comes by its own address.

use core::net::Ipv4Addr;

use heapless::String;

/// Longest host name in bytes.
pub const HOST_NAME_BYTES_MAX: usize = 32;

/// A host's name, as a DHCP server is told it.
pub type HostName = String<HOST_NAME_BYTES_MAX, u8>;

/// How the board comes by its address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum OwnNetwork {
    /// A DHCP server gives it.
    Dhcp {
        /// What the board calls itself to the server; nothing when empty.
        name: HostName,
    },
    /// It is set.
    Static(StaticAddress),
}

/// An address that is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StaticAddress {
    /// The board's address.
    pub address: Ipv4Addr,
    /// Leading bits that the hosts of its network have in common, 1 to 30.
    pub prefix: u8,
    /// The way to other networks.
    pub gateway: Option<Ipv4Addr>,
    /// Who is asked for names.
    pub dns: Option<Ipv4Addr>,
}

impl OwnNetwork {
    /// What a board starts with.
    pub const DEFAULT: Self = Self::Dhcp { name: String::new() };
}

impl Default for OwnNetwork {
    fn default() -> Self {
        Self::DEFAULT
    }
}
