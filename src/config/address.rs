//! Addresses of peers: prefixes, and lists of those who may ask.

use core::net::IpAddr;

use heapless::Vec;

use super::RESERVED_MAX;

/// Peers that may ask; empty: everybody may.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Allowed(pub Vec<IpPrefix, RESERVED_MAX>);

impl Allowed {
    /// Everybody.
    pub const fn everybody() -> Self {
        Self(Vec::new())
    }

    /// Whether `peer` may ask.
    pub fn admits(&self, peer: IpAddr) -> bool {
        self.0.is_empty() || self.0.iter().any(|prefix| prefix.contains(peer))
    }
}

/// An IP address with a prefix length; a full length names one address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IpPrefix {
    /// The address; bits behind the prefix are zero.
    pub address: IpAddr,
    /// Leading bits that must agree: up to 32 for IPv4, up to 128 for IPv6.
    pub length: u8,
}

impl IpPrefix {
    /// Whether `peer` lies in the prefix. An IPv4 peer written as IPv6 (`::ffff:a.b.c.d`) counts as IPv4.
    pub fn contains(&self, peer: IpAddr) -> bool {
        match (self.address.to_canonical(), peer.to_canonical()) {
            (IpAddr::V4(own), IpAddr::V4(peer)) => {
                let shift = 32 - u32::from(self.length.min(32));
                own.to_bits().checked_shr(shift).unwrap_or(0)
                    == peer.to_bits().checked_shr(shift).unwrap_or(0)
            }
            (IpAddr::V6(own), IpAddr::V6(peer)) => {
                let shift = 128 - u32::from(self.length.min(128));
                own.to_bits().checked_shr(shift).unwrap_or(0)
                    == peer.to_bits().checked_shr(shift).unwrap_or(0)
            }
            _ => false,
        }
    }
}
