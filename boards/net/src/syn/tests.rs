//! Frames that are SYNs and frames that are not.

use mobgate_simulator::Random;
use smoltcp::wire::{EthernetFrame, EthernetProtocol, IpProtocol, Ipv4Packet, TcpPacket};

use super::{FLAGS, SYN_BYTES_MAX, Syn};

/// A SYN as Linux sends it: 192.168.7.1:43210 to 192.168.7.2:502, with 20 bytes of options.
const LINUX: [u8; 74] = [
    0x02, 0x00, 0x00, 0x00, 0x00, 0x02, 0x02, 0x00, 0x00, 0x00, 0x00, 0x01, 0x08, 0x00, 0x45, 0x00, 0x00,
    0x3c, 0x1c, 0x46, 0x40, 0x00, 0x40, 0x06, 0x8f, 0x21, 192, 168, 7, 1, 192, 168, 7, 2, 0xa8, 0xca, 0x01,
    0xf6, 0x5c, 0x12, 0x9e, 0x01, 0x00, 0x00, 0x00, 0x00, 0xa0, 0x02, 0xfa, 0xf0, 0x8f, 0x7e, 0x00, 0x00,
    0x02, 0x04, 0x05, 0xb4, 0x04, 0x02, 0x08, 0x0a, 0x9b, 0x3d, 0x5e, 0x11, 0x00, 0x00, 0x00, 0x00, 0x01,
    0x03, 0x03, 0x07,
];

/// The frame with other bytes at `at`.
fn with(at: usize, bytes: &[u8]) -> [u8; 74] {
    let mut frame = LINUX;
    frame[at..at + bytes.len()].copy_from_slice(bytes);
    frame
}

#[test]
fn a_syn_says_who_asks_for_which_port() {
    let syn = Syn::of(&LINUX).unwrap();
    assert_eq!(
        (syn.from, syn.to),
        ("192.168.7.1:43210".parse().unwrap(), "192.168.7.2:502".parse().unwrap())
    );
    assert_eq!(Syn::of(&with(38, &[1, 2, 3, 4])), Some(syn), "whatever its sequence number");
    assert_ne!(Syn::of(&with(34, &[1, 2])), Some(syn), "another client");
    assert_ne!(Syn::of(&with(29, &[9])), Some(syn), "another host");
    const { assert!(LINUX.len() <= SYN_BYTES_MAX) };
}

#[test]
fn other_frames_are_none() {
    let others: [(&str, usize, &[u8]); 9] = [
        ("SYN with ACK", FLAGS, &[0x12]),
        ("ACK", FLAGS, &[0x10]),
        ("data", FLAGS, &[0x18]),
        ("RST", FLAGS, &[0x06]),
        ("UDP", 23, &[17]),
        ("ARP", 12, &[0x08, 0x06]),
        ("IPv6", 12, &[0x86, 0xdd]),
        ("a later fragment", 21, &[0x10]),
        ("IP options", 14, &[0x46]),
    ];
    for (what, at, bytes) in others {
        assert_eq!(Syn::of(&with(at, bytes)), None, "{what}");
    }
    for length in 0..=FLAGS {
        assert_eq!(Syn::of(&LINUX[..length]), None, "{length} bytes");
    }
}

/// As the stack reads it.
fn is_syn(frame: &[u8]) -> Option<bool> {
    let ethernet = EthernetFrame::new_checked(frame).ok()?;
    let ip = Ipv4Packet::new_checked(ethernet.payload()).ok()?;
    let tcp = TcpPacket::new_checked(ip.payload()).ok()?;
    let is_tcp = ethernet.ethertype() == EthernetProtocol::Ipv4 && ip.next_header() == IpProtocol::Tcp;
    let is_whole = ip.version() == 4 && ip.header_len() == 20 && !ip.more_frags() && ip.frag_offset() == 0;
    Some(is_tcp && is_whole && tcp.syn() && !tcp.ack() && !tcp.rst())
}

#[test]
fn what_the_stack_reads_as_one_is_one() {
    let seed = 7;
    let mut random = Random::new(seed);
    let mut syns = 0;
    for round in 0..20_000 {
        let mut frame = LINUX;
        for _ in 0..random.index(3) {
            frame[random.index(54)] ^= 1 << random.index(8);
        }
        let Some(expected) = is_syn(&frame) else { continue };
        assert_eq!(Syn::of(&frame).is_some(), expected, "seed {seed}, round {round}: {frame:02x?}");
        syns += u32::from(expected);
    }
    assert!(syns > 10_000, "{syns}");
}
