//! The memory for the rows' values: bounded, bits packed from the lowest on, registers with the high byte first.

/// Bytes of values, inputs and outputs together.
pub const VALUE_BYTES_MAX: usize = if cfg!(feature = "long-images") { 4096 } else { 2048 };

/// The memory.
pub(super) struct Values {
    bytes: [u8; VALUE_BYTES_MAX],
    used: u16,
}

impl Values {
    pub(super) const fn new() -> Self {
        Self { bytes: [0; VALUE_BYTES_MAX], used: 0 }
    }

    /// Allocates `bytes`, and returns the index of the first.
    pub(super) fn allocate(&mut self, bytes: u16) -> Option<u16> {
        let first = self.used;
        let end = first.checked_add(bytes).filter(|end| usize::from(*end) <= VALUE_BYTES_MAX)?;
        self.used = end;
        Some(first)
    }

    pub(super) fn span(&self, first: u16, bytes: u16) -> &[u8] {
        let first = usize::from(first);
        self.bytes.get(first..first + usize::from(bytes)).unwrap_or_default()
    }

    pub(super) fn span_mut(&mut self, first: u16, bytes: u16) -> &mut [u8] {
        let first = usize::from(first);
        self.bytes.get_mut(first..first + usize::from(bytes)).unwrap_or_default()
    }

    /// Copies values to others, which do not overlap.
    pub(super) fn copy(&mut self, from: u16, to: u16, bytes: u16) {
        let (from, to, bytes) = (usize::from(from), usize::from(to), usize::from(bytes));
        for at in 0..bytes {
            let Some(&byte) = self.bytes.get(from + at) else { return };
            self.bytes.get_mut(to + at).into_iter().for_each(|there| *there = byte);
        }
    }

    pub(super) fn clear(&mut self) {
        self.bytes.fill(0);
        self.used = 0;
    }
}
