//! The status word of a row: sixteen bits with its state and the outcome of the last request.

use core::fmt;

use strum::VariantArray;

/// Why a request failed, as the number in bits 12 to 15.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, VariantArray)]
#[repr(u8)]
pub enum ErrorCode {
    /// An exception with another code than those below.
    #[default]
    Unspecified = 0,
    /// Exception 01.
    Function = 1,
    /// Exception 02.
    Address = 2,
    /// Exception 03.
    Value = 3,
    /// A response that does not match.
    Unknown = 4,
    /// No response in time.
    Timeout = 5,
    /// The response was corrupt.
    Transmission = 6,
    /// No path to the device: its line or connection is not open, its queue is full, or no rule leads to it.
    Connection = 7,
}

impl ErrorCode {
    /// Every code, by number.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// The code for a device's exception.
    pub const fn of_exception(exception: u8) -> Self {
        match exception {
            1 => Self::Function,
            2 => Self::Address,
            3 => Self::Value,
            _ => Self::Unspecified,
        }
    }

    /// A short text.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unspecified => "negative response",
            Self::Function => "illegal function",
            Self::Address => "illegal address",
            Self::Value => "illegal value",
            Self::Unknown => "unknown error",
            Self::Timeout => "no response",
            Self::Transmission => "corrupt response",
            Self::Connection => "no connection",
        }
    }
}

/// A row's status word.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct Status(u16);

impl Status {
    /// Nothing has happened yet.
    pub const NEW: Self = Self(0);
    /// A request is in progress.
    pub const IN_PROGRESS: Self = Self(1);
    /// The last request succeeded.
    pub const LAST_OK: Self = Self(1 << 1);
    /// The last request failed.
    pub const LAST_ERROR: Self = Self(1 << 2);
    /// The device does not respond, and backs off.
    pub const BACKING_OFF: Self = Self(1 << 4);
    /// Marked for reading.
    pub const READ_MARKED: Self = Self(1 << 6);
    /// Marked for writing.
    pub const WRITE_MARKED: Self = Self(1 << 7);
    /// A safe write has begun.
    pub const WRITE_BLOCKED: Self = Self(1 << 8);
    /// The variable was written again while its last value was being sent: it is sent once more.
    pub const WRITE_REMARKED: Self = Self(1 << 9);
    /// The request in progress is a write.
    pub const CURRENT_IS_WRITE: Self = Self(1 << 10);
    /// The last request was a write.
    pub const LAST_WAS_WRITE: Self = Self(1 << 11);
    const ERROR_SHIFT: u32 = 12;

    /// The named bits, from the lowest on.
    pub const NAMES: [(Self, &'static str); 10] = [
        (Self::IN_PROGRESS, "busy"),
        (Self::LAST_OK, "ok"),
        (Self::LAST_ERROR, "error"),
        (Self::BACKING_OFF, "backing-off"),
        (Self::READ_MARKED, "to-read"),
        (Self::WRITE_MARKED, "to-write"),
        (Self::WRITE_BLOCKED, "blocked"),
        (Self::WRITE_REMARKED, "to-write-again"),
        (Self::CURRENT_IS_WRITE, "writing"),
        (Self::LAST_WAS_WRITE, "wrote"),
    ];

    /// The word.
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// Whether any bit of `flags` is set.
    pub const fn any(self, flags: Self) -> bool {
        self.0 & flags.0 != 0
    }

    /// The bits of both.
    #[must_use]
    pub const fn with(self, flags: Self) -> Self {
        Self(self.0 | flags.0)
    }

    /// Why the last request failed.
    pub fn error(self) -> Option<ErrorCode> {
        if !self.any(Self::LAST_ERROR) {
            return None;
        }
        ErrorCode::ALL.get(usize::from(self.0 >> Self::ERROR_SHIFT)).copied()
    }

    pub(super) fn set(&mut self, flags: Self) {
        self.0 |= flags.0;
    }

    pub(super) fn clear(&mut self, flags: Self) {
        self.0 &= !flags.0;
    }

    /// Records the start of a request.
    pub(super) fn begin(&mut self, write: bool) {
        self.clear(if write { Self::WRITE_MARKED } else { Self::READ_MARKED });
        self.set(Self::IN_PROGRESS);
        if write {
            self.set(Self::CURRENT_IS_WRITE);
        }
    }

    /// Records that the request is no longer in progress; returns whether it was a write.
    pub(super) fn leave(&mut self) -> bool {
        let write = self.any(Self::CURRENT_IS_WRITE);
        self.clear(Self::IN_PROGRESS.with(Self::CURRENT_IS_WRITE));
        write
    }

    /// Records the end of the request.
    pub(super) fn end(&mut self, write: bool, outcome: Result<(), ErrorCode>) {
        self.clear(Self::LAST_OK.with(Self::LAST_ERROR).with(Self::LAST_WAS_WRITE));
        self.0 &= !(0xf << Self::ERROR_SHIFT);
        match outcome {
            Ok(()) => self.set(Self::LAST_OK),
            Err(error) => self.set(Self(Self::LAST_ERROR.0 | u16::from(error as u8) << Self::ERROR_SHIFT)),
        }
        if write {
            self.set(Self::LAST_WAS_WRITE);
        }
    }
}

impl fmt::Debug for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}h {self}", self.0)
    }
}

/// The names of the bits that are set, and the error: `error to-read (no response)`.
impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for (flag, name) in Self::NAMES {
            if self.any(flag) {
                write!(f, "{separator}{name}")?;
                separator = " ";
            }
        }
        match self.error() {
            Some(error) => write!(f, " ({})", error.name()),
            None if separator.is_empty() => f.write_str("new"),
            None => Ok(()),
        }
    }
}
