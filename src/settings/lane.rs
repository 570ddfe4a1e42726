//! A serial line, as far as the times of frames on it go.

use crate::settings::{Framing, LineSettings, PortId, PortKind, SerialSettings, Settings};

/// A serial line, as far as the times of frames on it go.
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

    /// Characters until a frame's unit is there.
    pub(crate) const fn unit_characters(&self) -> usize {
        match self.framing {
            Framing::Rtu => 1,
            Framing::Ascii => 3,
        }
    }

    /// Characters at the end of a copy that are held back until all of the frame is there which arrives on `input`.
    pub(crate) const fn held_back(&self, input: &Self) -> usize {
        match (input.framing, self.framing) {
            (_, Framing::Rtu) => 1,
            (Framing::Rtu, Framing::Ascii) => 4,
            (Framing::Ascii, Framing::Ascii) => 2,
        }
    }

    /// The time of `characters` on this line, in a unit that it shares with `other`.
    pub(crate) fn time(&self, characters: usize, other: &Self) -> u64 {
        characters as u64 * u64::from(self.line.bits_per_char()) * u64::from(other.line.baud)
    }
}
