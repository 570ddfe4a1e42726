//! Where the rows' values are: bytes of a bounded memory, bits packed from the lowest on, registers with the high byte first.

use super::row::Row;

/// Bytes of values that a scanner keeps, inputs and outputs together.
pub const VALUE_BYTES_MAX: usize = 2048;

/// The memory.
pub(super) struct Values {
    bytes: [u8; VALUE_BYTES_MAX],
    used: u16,
}

impl Values {
    pub(super) const fn new() -> Self {
        Self { bytes: [0; VALUE_BYTES_MAX], used: 0 }
    }

    /// The first of `bytes` new ones.
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

    /// Whether the row's inputs are others than its outputs. What stands behind the last bit is nobody's.
    pub(super) fn differ(&self, row: &Row) -> bool {
        let (kind, cells) = row.variable();
        let bytes = kind.bytes(cells);
        let (input, output) = (self.span(row.input, bytes), self.span(row.output, bytes));
        if kind.is_bits() {
            return (0..usize::from(cells)).any(|at| bit(input, at) != bit(output, at));
        }
        input != output
    }

    pub(super) fn clear(&mut self) {
        self.bytes.fill(0);
        self.used = 0;
    }
}

/// The bit at place `at` of `bytes`.
pub(super) fn bit(bytes: &[u8], at: usize) -> bool {
    bytes.get(at / 8).is_some_and(|byte| byte >> (at % 8) & 1 == 1)
}

/// Copies `count` bits between places in bytes.
pub(crate) fn copy_bits(from: &[u8], from_at: usize, to: &mut [u8], to_at: usize, count: usize) {
    for nth in 0..count {
        let value = bit(from, from_at + nth);
        let at = to_at + nth;
        if let Some(byte) = to.get_mut(at / 8) {
            *byte = *byte & !(1 << (at % 8)) | u8::from(value) << (at % 8);
        }
    }
}

/// In which order the four bytes of a value of 32 bits come from a device; byte 0 is the highest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ByteOrder {
    /// High word first, high byte first.
    #[default]
    Order0123,
    /// Low word first, high byte first.
    Order2301,
    /// High word first, low byte first.
    Order1032,
    /// Low word first, low byte first.
    Order3210,
}

impl ByteOrder {
    /// Turns values of 32 bits from a device's order into 0123, or back: each order is its own inverse.
    pub fn turn(self, values: &mut [u8]) {
        for value in values.as_chunks_mut::<4>().0 {
            let [a, b, c, d] = *value;
            *value = match self {
                Self::Order0123 => [a, b, c, d],
                Self::Order2301 => [c, d, a, b],
                Self::Order1032 => [b, a, d, c],
                Self::Order3210 => [d, c, b, a],
            };
        }
    }
}
