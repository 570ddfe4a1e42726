//! Bits of a register: one, or several next to each other that are a number.

use core::fmt;

use super::bits::bit;

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
}

/// One bit of a register, or several next to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RegisterBits {
    first: RegisterBit,
    // Others have single bits only.
    #[cfg(feature = "long-values")]
    last: RegisterBit,
}

impl RegisterBits {
    /// A single bit.
    pub const fn one(bit: RegisterBit) -> Self {
        Self {
            first: bit,
            #[cfg(feature = "long-values")] // As the field.
            last: bit,
        }
    }

    /// The bits from `first` to `last`, if these are several.
    #[cfg(feature = "long-values")] // As the field.
    pub fn several(first: u8, last: u8) -> Option<Self> {
        let [first_bit, last_bit] = [first, last].map(|nth| RegisterBit::ALL.get(usize::from(nth)).copied());
        (first < last).then_some(Self { first: first_bit?, last: last_bit? })
    }

    /// The lowest bit, from 0 on.
    pub const fn first(self) -> u8 {
        self.first as u8
    }

    /// The highest bit.
    #[cfg(feature = "long-values")] // As the field.
    pub const fn last(self) -> u8 {
        self.last as u8
    }

    /// The only bit.
    #[cfg(not(feature = "long-values"))] // As above.
    pub const fn last(self) -> u8 {
        self.first as u8
    }

    /// The number of bits.
    pub const fn count(self) -> u16 {
        (self.last() - self.first()) as u16 + 1
    }

    /// Whether it is a single bit.
    pub const fn is_one(self) -> bool {
        self.count() == 1
    }

    /// A register with only these bits set.
    pub(super) const fn mask(self) -> u16 {
        (u16::MAX >> (16 - self.count())) << self.first as u8
    }

    /// `register` with these bits from the variable.
    pub(super) fn put(self, register: u16, variable: &[u8]) -> u16 {
        let value = match self.is_one() {
            true => bit(variable, 0).into(),
            false => number(variable),
        };
        register & !self.mask() | value << self.first as u8 & self.mask()
    }

    /// Sets the variable by these bits of `register`.
    pub(super) fn take(self, register: u16, variable: &mut [u8]) {
        let value = (register & self.mask()) >> self.first as u8;
        match variable {
            [high, low] if !self.is_one() => [*high, *low] = value.to_be_bytes(),
            _ => variable.fill(value as u8),
        }
    }

    /// Whether these cells of a variable are a number of so many bits.
    pub(super) fn hold(self, cells: &[u8]) -> bool {
        self.is_one() || number(cells) <= self.mask() >> self.first as u8
    }
}

/// `3`, or `4-7`.
impl fmt::Display for RegisterBits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.first().fmt(f)?;
        if self.is_one() { Ok(()) } else { write!(f, "-{}", self.last()) }
    }
}

/// A variable of one register.
fn number(variable: &[u8]) -> u16 {
    variable.first_chunk().map_or(0, |bytes| u16::from_be_bytes(*bytes))
}
