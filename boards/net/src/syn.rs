//! Recognises a SYN, the first segment of a TCP connection.

use core::net::SocketAddrV4;

/// The longest that systems send: Ethernet, IPv4, TCP, and 24 bytes of options (macOS; Linux has 20, Windows 12).
pub(crate) const SYN_BYTES_MAX: usize = 14 + 20 + 20 + 24;

// Offsets in the frame.
const ETHER_TYPE: usize = 12;
const FRAGMENT: usize = 20;
const PROTOCOL: usize = 23;
const ADDRESSES: usize = 26;
const PORTS: usize = 34;
const FLAGS: usize = 47;

/// The Ethernet type of IPv4, its version, and its length without options.
const IPV4: [u8; 3] = [0x08, 0x00, 0x45];
/// More fragments follow, or did before.
const IS_FRAGMENT: u16 = 0x3fff;
const TCP: u8 = 6;
const SYN: u8 = 1 << 1;
const RST: u8 = 1 << 2;
const ACK: u8 = 1 << 4;

/// Source and destination of a connection request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Syn {
    from: SocketAddrV4,
    pub(crate) to: SocketAddrV4,
}

impl Syn {
    /// The SYN in an Ethernet frame. SYNs with IP options are not recognised; no common stack sends them.
    pub(crate) fn of(frame: &[u8]) -> Option<Self> {
        let head = frame.first_chunk::<{ FLAGS + 1 }>()?;
        let two = |at: usize| u16::from_be_bytes([head[at], head[at + 1]]);
        // First what tells most frames apart.
        let is_syn = head[FLAGS] & (SYN | RST | ACK) == SYN
            && head[PROTOCOL] == TCP
            && head[ETHER_TYPE..].starts_with(&IPV4)
            && two(FRAGMENT) & IS_FRAGMENT == 0;
        let end = |address: usize, port: usize| {
            let address = [head[address], head[address + 1], head[address + 2], head[address + 3]];
            SocketAddrV4::new(address.into(), two(port))
        };
        is_syn.then(|| Self { from: end(ADDRESSES, PORTS), to: end(ADDRESSES + 4, PORTS + 2) })
    }
}

#[cfg(test)]
mod tests;
