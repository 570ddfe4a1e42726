//! The four tables of a Modbus device, and what the protocol allows in each (Application Protocol 4.3, 6.1 to 6.12).

use core::fmt;

use crate::modbus::pdu::function::{
    READ_COILS, READ_DISCRETE_INPUTS, READ_HOLDING_REGISTERS, READ_INPUT_REGISTERS, WRITE_MULTIPLE_COILS,
    WRITE_MULTIPLE_REGISTERS, WRITE_SINGLE_COIL, WRITE_SINGLE_REGISTER,
};

/// A table of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Writable bits.
    Coil,
    /// Read-only bits.
    Discrete,
    /// Read-only registers.
    Input,
    /// Writable registers.
    Holding,
}

impl Kind {
    /// Every table, in polling order: functions 1, 2, 4, 3.
    pub const ALL: [Self; 4] = [Self::Coil, Self::Discrete, Self::Input, Self::Holding];

    /// The function that reads it.
    pub const fn read_function(self) -> u8 {
        match self {
            Self::Coil => READ_COILS,
            Self::Discrete => READ_DISCRETE_INPUTS,
            Self::Input => READ_INPUT_REGISTERS,
            Self::Holding => READ_HOLDING_REGISTERS,
        }
    }

    /// The table that `function` accesses, and whether it writes.
    pub const fn of_function(function: u8) -> Option<(Self, bool)> {
        Some(match function {
            READ_COILS => (Self::Coil, false),
            READ_DISCRETE_INPUTS => (Self::Discrete, false),
            READ_INPUT_REGISTERS => (Self::Input, false),
            READ_HOLDING_REGISTERS => (Self::Holding, false),
            WRITE_SINGLE_COIL | WRITE_MULTIPLE_COILS => (Self::Coil, true),
            WRITE_SINGLE_REGISTER | WRITE_MULTIPLE_REGISTERS => (Self::Holding, true),
            _ => return None,
        })
    }

    /// Whether its cells are bits rather than registers.
    pub const fn is_bits(self) -> bool {
        matches!(self, Self::Coil | Self::Discrete)
    }

    /// Whether it can be written.
    pub const fn is_writable(self) -> bool {
        matches!(self, Self::Coil | Self::Holding)
    }

    /// Most cells in one frame.
    pub const fn cells_max(self, write: bool) -> u16 {
        match (self.is_bits(), write) {
            (true, false) => 2000,
            (true, true) => 1968,
            (false, false) => 125,
            (false, true) => 123,
        }
    }

    /// Bytes of `cells` cells.
    pub const fn bytes(self, cells: u16) -> u16 {
        if self.is_bits() { cells.div_ceil(8) } else { cells.saturating_mul(2) }
    }

    /// The leading digit of Modicon addresses.
    pub const fn modicon(self) -> u32 {
        match self {
            Self::Coil => 0,
            Self::Discrete => 1,
            Self::Input => 3,
            Self::Holding => 4,
        }
    }
}

/// An address in Modicon notation, which starts at 1: `40001`, with six digits above 9999: `410001`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Modicon(pub Kind, pub u16);

impl Modicon {
    /// Parses `number`: `1`, `10001`, `30001`, `40001` and so on.
    pub fn parse(number: u32) -> Option<Self> {
        let of = |digit: u32, scale: u32| {
            let kind = Kind::ALL.into_iter().find(|kind| kind.modicon() == digit)?;
            let nth = number.checked_sub(digit * scale)?;
            u16::try_from(nth.checked_sub(1)?).ok().map(|address| Self(kind, address))
        };
        match number {
            1..=9_999 => of(0, 10_000),
            10_001..=19_999 | 30_001..=39_999 | 40_001..=49_999 => of(number / 10_000, 10_000),
            100_001..=165_536 | 300_001..=365_536 | 400_001..=465_536 => of(number / 100_000, 100_000),
            _ => None,
        }
    }
}

impl fmt::Display for Modicon {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = u32::from(self.1) + 1;
        write!(f, "{}{number:04}", self.0.modicon())
    }
}
