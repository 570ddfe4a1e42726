//! Registers that differ at every read, so that a response which is not this request's is found out.

use embassy_time::Instant;

/// Four registers: a counter of the reads, then the time of this read; each in two registers, high word first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Fresh {
    /// How many reads there have been, this one included.
    pub reads: u32,
    /// When the device executed the read, in microseconds; starts anew after 71 minutes.
    pub at_us: u32,
}

impl Fresh {
    /// Registers taken.
    pub const REGISTERS: u16 = 4;

    /// The values after one more read, now.
    #[must_use]
    pub fn next(self) -> Self {
        Self { reads: self.reads + 1, at_us: Instant::now().as_micros() as u32 }
    }

    /// As the registers show it.
    pub fn registers(self) -> [u16; 4] {
        let [reads, at] = [self.reads, self.at_us].map(|value| [(value >> 16) as u16, value as u16]);
        [reads[0], reads[1], at[0], at[1]]
    }

    /// From the response to a read (functions 3, 4) of exactly these registers.
    pub fn from_response(pdu: &[u8]) -> Option<Self> {
        let (&[3 | 4, 8], values) = pdu.split_first_chunk()? else { return None };
        let (reads, at_us) = values.split_first_chunk()?;
        let at_us = at_us.try_into().ok()?;
        Some(Self { reads: u32::from_be_bytes(*reads), at_us: u32::from_be_bytes(at_us) })
    }
}
