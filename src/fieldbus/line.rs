//! The serial line of the port: its settings from a MainDevice (2020h), and their origin.

use core::fmt::{self, Display};

use super::config_error::ConfigError;
use crate::settings::{LineSettings, Parity};

/// Settings of a serial line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Speed {
    /// Bits a second.
    pub baud: u32,
    /// Parity; RTU always has eight data bits.
    pub parity: Parity,
    /// One or two.
    pub stop_bits: u8,
}

impl Speed {
    /// No line; all zeros.
    pub(super) const NONE: Self = Self { baud: 0, parity: Parity::None, stop_bits: 0 };

    /// The settings of `line`.
    pub(crate) const fn of(line: &LineSettings) -> Self {
        Self { baud: line.baud, parity: line.parity, stop_bits: line.stop_bits }
    }

    /// Decodes the entries of 2020h. With parity, a MainDevice may either give eight data bits, or include the parity bit: 8E1 is
    /// `0,2` or `1,2`.
    pub(super) fn from_entries(entries: [u32; 4]) -> Result<Self, ConfigError> {
        let [baud, nine, parity, two_stop_bits] = entries;
        let parity = match (nine, parity) {
            (0, 0) => Parity::None,
            (_, 2) => Parity::Even,
            (_, 3) => Parity::Odd,
            _ => return Err(ConfigError::Character { bits: 8 + nine as u8, parity: parity as u8 }),
        };
        Ok(Self { baud, parity, stop_bits: 1 + two_stop_bits as u8 })
    }

    /// Encodes the entries of 2020h.
    pub(super) const fn entries(self) -> [u32; 4] {
        let (nine, parity) = match self.parity {
            Parity::None => (0, 0),
            Parity::Even => (1, 2),
            Parity::Odd => (1, 3),
        };
        [self.baud, nine, parity, (self.stop_bits == 2) as u32]
    }
}

/// As the settings write it: `19200 8E1`.
impl Display for Speed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { baud, parity, stop_bits } = *self;
        f.write_str(&LineSettings { baud, parity, stop_bits, ..LineSettings::DEFAULT }.speed())
    }
}

/// The origin of the line's present settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineWriter {
    /// The settings, as typed or loaded.
    Settings,
    /// The MainDevice.
    MainDevice,
    /// The settings, replacing those of the MainDevice.
    SettingsOver(Speed),
}

impl Display for LineWriter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Settings => Ok(()),
            Self::MainDevice => f.write_str("set by EtherCAT"),
            Self::SettingsOver(speed) => write!(f, "set here, EtherCAT had {speed}"),
        }
    }
}
