//! How the cells of a row map to the values of its variable: bits as numbers, a single bit of a register, 32-bit values.

use super::bits::bit;
use super::byte_order::ByteOrder;
use super::kind::Kind;

/// The mapping of a row's cells to its variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Each cell is a value: a bit, or a 16-bit register.
    Cells,
    /// Two registers are a 32-bit value, in the device's byte order.
    Wide,
    /// Sixteen bits are a number, lowest bit first.
    Words,
    /// Likewise 32 bits.
    Longs,
    /// One bit of a register is a value.
    Bit(RegisterBit),
}

impl Form {
    /// The table and number of cells of the variable of a row with `count` cells of `kind`.
    pub(super) fn variable(self, kind: Kind, count: u16) -> (Kind, u16) {
        match self {
            Self::Cells | Self::Wide => (kind, count),
            Self::Words | Self::Longs => (Kind::Holding, count / 16),
            Self::Bit(_) => (Kind::Coil, count),
        }
    }

    /// Converts values from their order in frames, or back: each form is its own inverse.
    pub(super) fn turn(self, order: ByteOrder, values: &mut [u8]) {
        let bytes = match self {
            Self::Wide => return order.turn(values),
            Self::Words => 2,
            Self::Longs => 4,
            Self::Cells | Self::Bit(_) => return,
        };
        values.chunks_exact_mut(bytes).for_each(<[u8]>::reverse);
    }
}

/// A bit of a register, from the lowest on.
// An enum rather than a number, so that its `Option` needs no extra memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)] // The names are self-explanatory.
#[rustfmt::skip] // Keeps it in two lines.
pub enum RegisterBit {
    B0, B1, B2, B3, B4, B5, B6, B7,
    B8, B9, B10, B11, B12, B13, B14, B15,
}

impl RegisterBit {
    /// All bits.
    #[rustfmt::skip]
    pub const ALL: [Self; 16] = [
        Self::B0, Self::B1, Self::B2, Self::B3, Self::B4, Self::B5, Self::B6, Self::B7,
        Self::B8, Self::B9, Self::B10, Self::B11, Self::B12, Self::B13, Self::B14, Self::B15,
    ];

    /// A register with only this bit set, if it is `on`.
    pub const fn mask(self, on: bool) -> u16 {
        (on as u16) << self as u8
    }

    /// `register` with this bit from the variable.
    pub(super) fn put(self, register: u16, variable: &[u8]) -> u16 {
        register & !self.mask(true) | self.mask(bit(variable, 0))
    }

    /// This bit of `register`, for the variable.
    pub(super) fn take(self, register: u16) -> u8 {
        (register >> self as u8 & 1) as u8
    }
}
