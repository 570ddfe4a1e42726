//! What asks for a reset: a magic word, byte by byte (II, 0040h and 0041h).

/// What must be written to a reset register, one after the other.
const MAGIC: [u8; 3] = *b"RES";

/// How much of the magic has been written.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ResetSequence(usize);

impl ResetSequence {
    /// Takes a written byte; whether the magic is complete.
    pub(crate) fn step(&mut self, byte: u8) -> bool {
        self.0 = match self.0 {
            at if MAGIC[at] == byte => at + 1,
            _ => usize::from(MAGIC[0] == byte),
        };
        self.0 == MAGIC.len() && std::mem::take(&mut self.0) > 0
    }
}
