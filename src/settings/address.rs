//! Peer addresses: prefixes, access lists, and how addresses are printed.

use core::fmt::{self, Display};
// Without the feature `ipv6`, see `Stored`.
#[cfg(not(feature = "ipv6"))]
use core::net::Ipv4Addr;
use core::net::{IpAddr, SocketAddr};

use heapless::Vec;

use crate::settings::RESERVED_MAX;

/// A list of prefixes. Settings hold several copies of several lists, so its length is a byte.
pub type Prefixes = Vec<IpPrefix, RESERVED_MAX, u8>;

/// Whether IPv6 addresses exist. Without the feature `ipv6` settings have none and no peer has one, so their code can be left
/// out.
pub(crate) const IPV6: bool = cfg!(feature = "ipv6");

/// Allowed peers; empty: everybody.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Allowed(pub Prefixes);

impl Allowed {
    /// Everybody.
    pub const fn everybody() -> Self {
        Self(Vec::new())
    }

    /// Whether some peer is allowed by both.
    // As the devices that connect.
    #[cfg(feature = "dial-in")]
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let meets = |own: &IpPrefix| other.0.iter().any(|other| own.covers(other) || other.covers(own));
        self.0.is_empty() || other.0.is_empty() || self.0.iter().any(meets)
    }

    /// Whether `peer` is allowed.
    pub fn admits(&self, peer: IpAddr) -> bool {
        self.0.is_empty() || self.0.iter().any(|prefix| prefix.contains(peer))
    }
}

/// An IP address with a prefix length; a full length names one address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IpPrefix {
    /// Bits after the prefix are zero.
    address: Stored,
    length: u8,
}

/// Rows of the table must be small: an address is 17 bytes long where it may be one of IPv6, and 4 where it may not.
#[cfg(feature = "ipv6")]
type Stored = IpAddr;
#[cfg(not(feature = "ipv6"))]
type Stored = Ipv4Addr;

impl IpPrefix {
    /// The addresses that agree with `address` in the first `length` bits: up to 32 for IPv4, up to 128 for IPv6. The other bits of
    /// `address` are zero. `None` for IPv6 without the feature `ipv6`.
    pub fn new(address: IpAddr, length: u8) -> Option<Self> {
        // The types differ.
        #[cfg(not(feature = "ipv6"))]
        let IpAddr::V4(address) = address else { return None };
        Some(Self { address, length })
    }

    fn address(&self) -> IpAddr {
        #[cfg(feature = "ipv6")]
        return self.address;
        #[cfg(not(feature = "ipv6"))]
        return IpAddr::V4(self.address);
    }

    /// Whether `other` is contained in this prefix.
    pub(crate) fn covers(&self, other: &Self) -> bool {
        self.length <= other.length && self.contains(other.address())
    }

    /// Whether `peer` matches the prefix. An IPv4 peer written as IPv6 (`::ffff:a.b.c.d`) counts as IPv4.
    pub fn contains(&self, peer: IpAddr) -> bool {
        let length = u32::from(self.length);
        match (canonical(self.address()), canonical(peer)) {
            (IpAddr::V4(own), IpAddr::V4(peer)) => {
                (own.to_bits() ^ peer.to_bits()).leading_zeros() >= length.min(32)
            }
            (IpAddr::V6(own), IpAddr::V6(peer)) if IPV6 => {
                (own.to_bits() ^ peer.to_bits()).leading_zeros() >= length.min(128)
            }
            _ => false,
        }
    }
}

/// Converts `::ffff:a.b.c.d`, the form in which some systems write IPv4 peers.
pub(crate) fn canonical(address: IpAddr) -> IpAddr {
    if IPV6 { address.to_canonical() } else { address }
}

/// `192.168.1.7` for a whole address, `192.168.1.0/24` for a prefix.
impl Display for IpPrefix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bits = if self.address().is_ipv4() { 32 } else { 128 };
        Address(self.address()).fmt(f)?;
        if self.length == bits { Ok(()) } else { write!(f, "/{}", self.length) }
    }
}

/// An address in printed form.
pub(crate) struct Address(pub(crate) IpAddr);

impl Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            IpAddr::V6(address) if IPV6 => address.fmt(f),
            IpAddr::V6(_) => Ok(()),
            IpAddr::V4(address) => address.fmt(f),
        }
    }
}

/// An address with its port number in printed form: `192.168.1.7:502`, `[::1]:502`.
pub(crate) struct Endpoint(pub(crate) SocketAddr);

impl Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            SocketAddr::V6(endpoint) if IPV6 => write!(f, "{endpoint}"),
            SocketAddr::V6(_) => Ok(()),
            SocketAddr::V4(endpoint) => write!(f, "{}:{}", endpoint.ip(), endpoint.port()),
        }
    }
}
