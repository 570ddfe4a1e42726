//! Operations that a program starts on a row, and their progress.

use strum::{EnumCount, FromRepr};

use super::status::ErrorCode;

/// An immediate operation on a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, FromRepr)]
#[repr(u8)]
pub enum Operation {
    /// Read it.
    Read = 1,
    /// Write its variable.
    Write = 2,
    /// Begin a safe write.
    Begin = 3,
    /// Finish the safe write, and write the row.
    Finish = 4,
}

/// The progress of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, FromRepr, EnumCount)]
#[repr(u8)]
pub(super) enum Progress {
    /// There has been no command.
    None,
    ReadWaits,
    ReadSent,
    WriteWaits,
    WriteSent,
    Begun,
    Done,
    Failed,
}

impl Progress {
    pub(super) const fn is_under_way(self) -> bool {
        matches!(self, Self::ReadWaits | Self::ReadSent | Self::WriteWaits | Self::WriteSent | Self::Begun)
    }

    /// The number shown to programs.
    pub(super) const fn number(self) -> u8 {
        match self {
            Self::None => 0,
            Self::ReadWaits | Self::ReadSent | Self::WriteWaits | Self::WriteSent => 1,
            Self::Done => 2,
            Self::Failed => 3,
            Self::Begun => 4,
        }
    }
}

/// The last command that a row accepted, packed into a byte, as there are many rows. Its progress is in the lowest three bits.
#[derive(Clone, Copy)]
pub(super) struct Command(u8);

impl Command {
    pub(super) const NONE: Self = Self::new(0, Progress::None);

    pub(super) const fn new(requester: u8, progress: Progress) -> Self {
        Self(requester << 3 | progress as u8)
    }

    pub(super) fn requester(self) -> u8 {
        self.0 >> 3
    }

    pub(super) fn progress(self) -> Progress {
        Progress::from_repr(self.0 & 7).unwrap_or(Progress::None)
    }

    /// Changes from one of `from` to `to`; otherwise nothing changes.
    pub(super) fn pass(&mut self, from: &[Progress], to: Progress) {
        if from.contains(&self.progress()) {
            *self = Self::new(self.requester(), to);
        }
    }

    /// Records that a request for the row is sent.
    pub(super) fn sent(&mut self, write: bool) {
        let (waits, sent) = match write {
            false => (Progress::ReadWaits, Progress::ReadSent),
            true => (Progress::WriteWaits, Progress::WriteSent),
        };
        self.pass(&[waits], sent);
    }

    /// Records the end of a request for the row.
    pub(super) fn ended(&mut self, write: bool, outcome: Result<(), ErrorCode>) {
        let to = if outcome.is_ok() { Progress::Done } else { Progress::Failed };
        self.pass(&[if write { Progress::WriteSent } else { Progress::ReadSent }], to);
    }

    /// Records that a pending read of the row is dropped.
    pub(super) fn read_dropped(&mut self) {
        self.pass(&[Progress::ReadWaits], Progress::Failed);
    }

    /// Records that the row's device backs off.
    pub(super) fn left_alone(&mut self) {
        self.pass(&[Progress::ReadWaits, Progress::WriteWaits], Progress::Failed);
    }

    /// Records that the safe write was abandoned.
    pub(super) fn abandoned(&mut self) {
        self.pass(&[Progress::Begun], Progress::Failed);
    }

    /// Records that the safe write was finished, by any requester.
    pub(super) fn finished(&mut self) {
        self.pass(&[Progress::Begun], Progress::WriteWaits);
    }
}
