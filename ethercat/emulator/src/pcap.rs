//! Captures of frames for Wireshark.

use std::io::{self, Write};

use super::Nanos;

/// Marks a capture with nanosecond timestamps.
const MAGIC: u32 = 0xA1B2_3C4D;
const VERSION: [u16; 2] = [2, 4];
const FRAME_BYTES_MAX: u32 = 65_535;
const LINK_ETHERNET: u32 = 1;
const NANOS_PER_SECOND: u64 = 1_000_000_000;

/// Writes a capture.
pub struct Pcap<W>(W);

impl<W: Write> Pcap<W> {
    /// Starts a capture.
    pub fn new(mut into: W) -> io::Result<Self> {
        into.write_all(&MAGIC.to_le_bytes())?;
        for half in VERSION {
            into.write_all(&half.to_le_bytes())?;
        }
        // Time zone and accuracy, unused in practice.
        into.write_all(&[0; 8])?;
        into.write_all(&FRAME_BYTES_MAX.to_le_bytes())?;
        into.write_all(&LINK_ETHERNET.to_le_bytes())?;
        Ok(Self(into))
    }

    /// Adds a frame.
    pub fn frame(&mut self, at: Nanos, frame: &[u8]) -> io::Result<()> {
        let length = frame.len() as u32;
        for field in [(at / NANOS_PER_SECOND) as u32, (at % NANOS_PER_SECOND) as u32, length, length] {
            self.0.write_all(&field.to_le_bytes())?;
        }
        self.0.write_all(frame)
    }
}
