//! PCAPNG files that Wireshark decodes without configuration: exported PDUs (link type 252) that name their dissector.
//!
//! RTU frames go to the dissector `mbrtu`, those of Modbus TCP to `mbtcp` and `mbudp`; ASCII frames and invalid frames are shown as
//! bytes. Clauses are those of draft-ietf-opsawg-pcapng; numbers are little-endian, as the section's magic declares.

use embassy_time::Instant;
use heapless::Vec;

use super::{Captured, FrameKind, Head};
use crate::stats::Event;

/// Size of the largest block without a frame's bytes.
const BLOCK_BYTES_MAX: usize = 80;
/// A block, or the part of one before or after a frame.
pub(super) type Block = Vec<u8, BLOCK_BYTES_MAX>;

const SECTION_HEADER: u32 = 0x0a0d_0d0a;
const INTERFACE: u32 = 1;
const INTERFACE_STATISTICS: u32 = 5;
const ENHANCED_PACKET: u32 = 6;
/// `LINKTYPE_WIRESHARK_UPPER_PDU`: tags precede each packet.
const UPPER_PDU: u16 = 252;
const TAG_END: u16 = 0;
const TAG_DISSECTOR: u16 = 12;
const TAG_PORT_TYPE: u16 = 24;
const TAG_SOURCE_PORT: u16 = 25;
const TAG_DESTINATION_PORT: u16 = 26;
const PORT_TYPE_TCP: u32 = 2;
const PORT_TYPE_UDP: u32 = 3;
/// The port by which dissectors distinguish requests from responses.
const MODBUS_PORT: u32 = 502;
const OPTION_COMMENT: u16 = 1;
const OPTION_FLAGS: u16 = 2;
const OPTION_NAME: u16 = 2;
const OPTION_DROPPED: u16 = 5;
const INBOUND: u32 = 1;
const OUTBOUND: u32 = 2;
const CRC_ERROR: u32 = 1 << 24;
const TOO_SHORT: u32 = 1 << 26;

/// The section header block, which starts the file.
pub(super) fn header() -> Block {
    block(SECTION_HEADER, |block| {
        put(block, &0x1a2b_3c4d_u32.to_le_bytes());
        // Version 1.0; the length of the section is unknown.
        put(block, &[1, 0, 0, 0]);
        put(block, &u64::MAX.to_le_bytes());
    })
}

/// The block of the next interface, called `name`.
pub(super) fn interface(name: &str) -> Block {
    block(INTERFACE, |block| {
        put(block, &UPPER_PDU.to_le_bytes());
        // Reserved, and no snapshot length.
        put(block, &[0; 6]);
        option(block, OPTION_NAME, name.as_bytes());
        option(block, 0, &[]);
    })
}

/// The number of frames lost so far, with the time of the next one, or of now. They may belong to any interface; the count is stored with
/// the first.
pub(super) fn statistics(at: Instant, epoch_us: u64, dropped: u64) -> Block {
    let at = epoch_us.wrapping_add(at.as_micros());
    block(INTERFACE_STATISTICS, |block| {
        for field in [0, (at >> 32) as u32, at as u32] {
            put(block, &field.to_le_bytes());
        }
        option(block, OPTION_DROPPED, &dropped.to_le_bytes());
        option(block, 0, &[]);
    })
}

/// The part before a frame's bytes; its port is the interface. `epoch_us`: start of the gateway's clock, in microseconds since 1970.
pub(super) fn before(frame: &Captured, epoch_us: u64) -> Block {
    let at = epoch_us.wrapping_add(frame.head.at.as_micros());
    let length = (tags(frame).len() + frame.length()) as u32;
    let interface = u32::from(frame.head.port.0);
    let mut before = Block::new();
    for field in [ENHANCED_PACKET, whole(frame), interface, (at >> 32) as u32, at as u32, length, length] {
        put(&mut before, &field.to_le_bytes());
    }
    put(&mut before, &tags(frame));
    before
}

/// The part after a frame's bytes.
pub(super) fn behind(frame: &Captured) -> Block {
    let mut behind = options(frame);
    put(&mut behind, &whole(frame).to_le_bytes());
    behind
}

/// The length of a frame's block: type, two lengths, five fields, the tags, the frame, and the options.
fn whole(frame: &Captured) -> u32 {
    (8 + 20 + tags(frame).len() + frame.length() + options(frame).len() + 4) as u32
}

/// The padding of a frame's bytes, and the options of its block.
fn options(frame: &Captured) -> Block {
    let mut options = Block::new();
    pad(&mut options, frame.length());
    option(&mut options, OPTION_COMMENT, frame.head.verdict.name().as_bytes());
    option(&mut options, OPTION_FLAGS, &flags(frame).to_le_bytes());
    option(&mut options, 0, &[]);
    options
}

fn flags(frame: &Captured) -> u32 {
    let direction = if frame.head.sent { OUTBOUND } else { INBOUND };
    direction
        | match frame.head.verdict {
            Event::BadCheck => CRC_ERROR,
            Event::Short => TOO_SHORT,
            _ => 0,
        }
}

/// The tags that describe a packet, big-endian.
fn tags(frame: &Captured) -> Vec<u8, 48> {
    let Head { kind, verdict, requester, .. } = frame.head;
    let dissector: Option<&[u8]> = match (verdict, kind) {
        (Event::Short | Event::Parity | Event::Framing | Event::Noise | Event::Corrupt, _) => None,
        (Event::Malformed, _) | (_, FrameKind::Ascii) => None,
        (_, FrameKind::Rtu) => Some(b"mbrtu\0\0\0"),
        (_, FrameKind::Tcp) => Some(b"mbtcp\0\0\0"),
        (_, FrameKind::Udp) => Some(b"mbudp\0\0\0"),
    };
    let mut tags = Vec::new();
    let mut tag = |tag: u16, value: &[u8]| {
        // Fits: all of them take 40 bytes.
        let _ = tags.extend_from_slice(&tag.to_be_bytes());
        let _ = tags.extend_from_slice(&(value.len() as u16).to_be_bytes());
        let _ = tags.extend_from_slice(value);
    };
    if let Some(dissector) = dissector {
        tag(TAG_DISSECTOR, dissector);
        let [source, destination] = match verdict {
            Event::Request | Event::Echo => [requester.into(), MODBUS_PORT],
            // Frames of other devices on a shared bus: the dissector guesses.
            Event::Foreign => [0, 0],
            _ => [MODBUS_PORT, requester.into()],
        };
        let port_type = if kind == FrameKind::Udp { PORT_TYPE_UDP } else { PORT_TYPE_TCP };
        tag(TAG_PORT_TYPE, &port_type.to_be_bytes());
        tag(TAG_SOURCE_PORT, &source.to_be_bytes());
        tag(TAG_DESTINATION_PORT, &destination.to_be_bytes());
    } else {
        tag(TAG_DISSECTOR, b"data");
    }
    tag(TAG_END, &[]);
    tags
}

/// A block of `kind`, with its length before and after `body`.
fn block(kind: u32, body: impl FnOnce(&mut Block)) -> Block {
    let mut block = Block::new();
    put(&mut block, &kind.to_le_bytes());
    put(&mut block, &[0; 4]);
    body(&mut block);
    let length = (block.len() as u32 + 4).to_le_bytes();
    put(&mut block, &length);
    if let Some(field) = block.get_mut(4..8) {
        field.copy_from_slice(&length);
    }
    block
}

fn option(block: &mut Block, code: u16, value: &[u8]) {
    put(block, &code.to_le_bytes());
    put(block, &(value.len() as u16).to_le_bytes());
    put(block, value);
    pad(block, value.len());
}

/// Pads `bytes` to a multiple of four.
fn pad(block: &mut Block, bytes: usize) {
    (bytes..bytes.next_multiple_of(4)).for_each(|_| put(block, &[0]));
}

fn put(block: &mut Block, bytes: &[u8]) {
    // Fits, see BLOCK_BYTES_MAX: names have limits.
    let _ = block.extend_from_slice(bytes);
}
