//! The reset request: a magic word, written byte by byte (II, 0040h and 0041h).

/// The bytes to write to a reset register, in order.
const MAGIC: [u8; 3] = *b"RES";

/// Number of magic bytes written so far.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ResetSequence(usize);

impl ResetSequence {
    /// Takes a written byte; returns whether the magic is complete.
    pub(crate) fn step(&mut self, byte: u8) -> bool {
        self.0 = match self.0 {
            at if MAGIC[at] == byte => at + 1,
            _ => usize::from(MAGIC[0] == byte),
        };
        self.0 == MAGIC.len() && std::mem::take(&mut self.0) > 0
    }
}
