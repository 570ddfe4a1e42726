//! Sets of function codes, for rules.

use crate::modbus::pdu::EXCEPTION_BIT;
use crate::modbus::pdu::function::{ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION};

/// A set of function codes from 1 to 127. It can also contain device identification (MEI type 14) without the rest of function
/// 43.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Functions([u16; 8]);

/// The bit for device identification alone: no function has this code.
const IDENTIFICATION: u8 = 0;

impl Functions {
    /// Every code.
    pub const ALL: Self = Self([!1, !0, !0, !0, !0, !0, !0, !0]);
    /// No code; add some with [`Functions::with`].
    pub const NONE: Self = Self([0; 8]);
    /// Functions that change nothing in the device. Of 43 only identification, since it also carries CANopen writes; not 8, which
    /// can restart a device.
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

    /// Whether it is `other`. Every request asks; the comparison of bytes that `==` is takes three times as long on a Cortex-M.
    pub(crate) fn is(&self, other: &Self) -> bool {
        self.0.iter().zip(&other.0).fold(0, |differ, (own, other)| differ | (own ^ other)) == 0
    }

    /// Adds `function`, from 1 to 127.
    #[must_use]
    pub const fn with(self, function: u8) -> Self {
        let mut set = self.with_bit(function);
        if function == ENCAPSULATED_INTERFACE {
            set.0[0] &= !(1 << IDENTIFICATION);
        }
        set
    }

    /// Adds device identification.
    #[must_use]
    pub const fn with_identification(self) -> Self {
        if self.contains(ENCAPSULATED_INTERFACE) { self } else { self.with_bit(IDENTIFICATION) }
    }

    /// Whether `function` is in the set, with all its sub-functions.
    pub const fn contains(&self, function: u8) -> bool {
        function != IDENTIFICATION && function < EXCEPTION_BIT && self.has_bit(function)
    }

    /// Whether the set has device identification, but not all of function 43.
    pub const fn contains_identification(&self) -> bool {
        self.has_bit(IDENTIFICATION)
    }

    /// Whether `request` is in the set; false if nothing of it has arrived.
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

/// Index of the word with the bit of `function`.
const fn word(function: u8) -> usize {
    (function & !EXCEPTION_BIT) as usize / 16
}
