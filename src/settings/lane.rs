//! The timing of a serial line, for cut-through.

use crate::settings::{Framing, LineSettings, PortId, PortKind, SerialSettings, Settings};

/// The settings of a serial line that determine the timing of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lane {
    /// RTU or ASCII.
    pub framing: Framing,
    /// Speed and character format.
    pub line: LineSettings,
}

impl Lane {
    /// The line of a port with these settings.
    pub const fn of(settings: &SerialSettings) -> Self {
        Self { framing: settings.framing, line: settings.line }
    }

    /// The line of `port`, if it is a serial one.
    pub(crate) fn at(settings: &Settings, port: PortId) -> Option<Self> {
        match &settings.port(port)?.kind {
            PortKind::Serial(serial) => Some(Self::of(serial)),
            _ => None,
        }
    }

    /// Characters of a frame of `bytes` bytes without its check.
    pub(crate) const fn characters(&self, bytes: usize) -> usize {
        match self.framing {
            Framing::Rtu => bytes + 2,
            Framing::Ascii => 2 * bytes + 5,
        }
    }

    /// Characters up to the end of a frame's unit.
    pub(crate) const fn unit_characters(&self) -> usize {
        match self.framing {
            Framing::Rtu => 1,
            Framing::Ascii => 3,
        }
    }

    /// Characters at the end of a frame that are held back until it has arrived completely on `input`.
    pub(crate) const fn held_back(&self, input: &Self) -> usize {
        match (input.framing, self.framing) {
            (_, Framing::Rtu) => 1,
            (Framing::Rtu, Framing::Ascii) => 4,
            (Framing::Ascii, Framing::Ascii) => 2,
        }
    }

    /// The duration of `characters` on this line, in a unit common with `other`.
    pub(crate) fn time(&self, characters: usize, other: &Self) -> u64 {
        characters as u64 * u64::from(self.line.bits_per_char()) * u64::from(other.line.baud)
    }
}
