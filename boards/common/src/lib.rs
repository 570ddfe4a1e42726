//! Chip-independent parts of the boards' firmware, tested on a host.
//!
//! [`clock`] is the embassy-time driver, [`relay`] hands characters from one line on to another, [`liveness`] decides when the watchdog
//! may be fed, [`last_words`] carry a panic message over the reset, and [`ethernet_address`] derives an Ethernet address from a chip's
//! unique number.
#![no_std]
#![forbid(unsafe_code)]

pub mod clock;
pub mod last_words;
pub mod liveness;
pub mod relay;

/// A chip's Ethernet address, from its unique number: locally administered, unicast.
///
/// A hash, because the unique numbers of chips from one wafer differ in few bits. Among a million boards, the probability that two
/// share one of the 2^46 addresses is less than 1 %.
pub fn ethernet_address(unique: &[u8]) -> [u8; 6] {
    // 64-bit FNV-1a.
    let hash = unique.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
    });
    let [first, rest @ .., _, _] = (hash ^ hash >> 32).to_be_bytes();
    let [b, c, d, e, f] = rest;
    // IEEE 802: bit 1 of the first byte is "locally administered", bit 0 is "group".
    [first & !1 | 2, b, c, d, e, f]
}

#[cfg(test)]
mod tests {
    use mobgate_clock as _;

    use super::ethernet_address;

    #[test]
    fn neighbours_on_a_wafer_get_different_local_addresses_and_keep_them() {
        let address = |x| ethernet_address(&[x, 0, 39, 0, 10, 81, 51, 49, 53, 50, 51, 52]);
        assert_eq!(address(1), address(1));
        let mut all: Vec<_> = (0..=255).map(address).collect();
        assert!(all.iter().all(|[first, ..]| first & 3 == 2));
        all.sort();
        all.dedup();
        assert_eq!(all.len(), 256);
    }

    extern crate std;
    use std::vec::Vec;
}
