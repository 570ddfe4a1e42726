//! How the cells of a row map to the values of its variable: bits as numbers, bits of a register, values of several registers.

use super::byte_order::ByteOrder;
use super::kind::Kind;
use super::long::LongForm;
use super::register_bits::RegisterBits;

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
    /// Longer values.
    Long(LongForm),
    /// One bit of a register is a value, or several are a number.
    Bits(RegisterBits),
}

impl Form {
    /// The table and number of cells of the variable of a row with `count` cells of `kind`.
    pub(super) fn variable(self, kind: Kind, count: u16) -> (Kind, u16) {
        match self {
            Self::Cells | Self::Wide => (kind, count),
            Self::Words | Self::Longs => (Kind::Holding, count / 16),
            Self::Long(form) if form.is_of_bits() => (Kind::Holding, count / 16),
            Self::Bits(bits) if bits.is_one() => (Kind::Coil, count),
            Self::Long(_) | Self::Bits(_) => (kind, count),
        }
    }

    /// Cells of a value that frames must not part, less one.
    pub(super) const fn rest(self) -> u16 {
        match self {
            Self::Wide => 1,
            Self::Long(form) => form.rest(),
            _ => 0,
        }
    }

    /// Converts values from their order in frames, or back: each form is its own inverse.
    pub(crate) fn turn(self, order: ByteOrder, values: &mut [u8]) {
        let bytes = match self {
            Self::Wide => return order.turn(values),
            Self::Words => 2,
            Self::Longs => 4,
            Self::Long(form) => return form.turn(order, values),
            Self::Cells | Self::Bits(_) => return,
        };
        values.chunks_exact_mut(bytes).for_each(<[u8]>::reverse);
    }
}
