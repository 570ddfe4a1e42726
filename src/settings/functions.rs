//! Sets of functions, as rules name them.

use crate::modbus::pdu::EXCEPTION_BIT;
use crate::modbus::pdu::function::{ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION};

/// Which functions a rule lets through: a set over the codes 1 to 127. Of function 43 there may also be only the device
/// identification (MEI type 14) in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Functions([u16; 8]);

/// The bit of the device identification, where 43 is not in the set: no function has this code.
const IDENTIFICATION: u8 = 0;

impl Functions {
    /// Every code.
    pub const ALL: Self = Self([!1, !0, !0, !0, !0, !0, !0, !0]);
    /// No code; add some with [`Functions::with`].
    pub const NONE: Self = Self([0; 8]);
    /// What changes nothing in the device. Not all of 43: besides the identification it carries CANopen requests, writes
    /// among them; nor 8, which can restart a device.
    pub const READ_ONLY: Self = Self::NONE
        .with(1)
        .with(2)
        .with(3)
        .with(4)
        .with(7)
        .with(11)
        .with(12)
        .with(17)
        .with(20)
        .with(24)
        .with_identification();

    /// The set and `function`, from 1 to 127, besides.
    #[must_use]
    pub const fn with(self, function: u8) -> Self {
        let mut set = self.with_bit(function);
        if function == ENCAPSULATED_INTERFACE {
            set.0[0] &= !(1 << IDENTIFICATION);
        }
        set
    }

    /// The set and the device identification besides.
    #[must_use]
    pub const fn with_identification(self) -> Self {
        if self.contains(ENCAPSULATED_INTERFACE) { self } else { self.with_bit(IDENTIFICATION) }
    }

    /// Whether `function` is in the set with all that it carries.
    pub const fn contains(&self, function: u8) -> bool {
        function != IDENTIFICATION && function < EXCEPTION_BIT && self.has_bit(function)
    }

    /// Whether of function 43 only the device identification is in the set.
    pub const fn contains_identification(&self) -> bool {
        self.has_bit(IDENTIFICATION)
    }

    /// Whether `request` is in the set; one of which nothing has come is in none.
    pub const fn admit(&self, request: &[u8]) -> bool {
        match *request {
            [ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, ..] if self.contains_identification() => true,
            [function, ..] => self.contains(function),
            [] => false,
        }
    }

    const fn with_bit(self, bit: u8) -> Self {
        let mut words = self.0;
        if let Some((_, [word, ..])) = words.split_at_mut_checked(word(bit)) {
            *word |= 1 << (bit % 16);
        }
        Self(words)
    }

    const fn has_bit(&self, bit: u8) -> bool {
        match self.0.split_at_checked(word(bit)) {
            Some((_, [word, ..])) => *word >> (bit % 16) & 1 == 1,
            _ => false,
        }
    }
}

/// The word that has the bit of `function`.
const fn word(function: u8) -> usize {
    (function & !EXCEPTION_BIT) as usize / 16
}
