//! What a program has a row do, and how that is doing.

use super::status::ErrorCode;

/// What is done with a row at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Operation {
    /// It is read.
    Read = 1,
    /// It is written as its variable is.
    Write = 2,
    /// A safe write begins.
    Begin = 3,
    /// The safe write is finished: it is written.
    Finish = 4,
}

impl Operation {
    const ALL: [Self; 4] = [Self::Read, Self::Write, Self::Begin, Self::Finish];

    pub(super) fn of(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|operation| *operation as u8 == number)
    }
}

/// How a command is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Progress {
    /// There has been none.
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
    pub(super) const ALL: [Self; 8] = [
        Self::None,
        Self::ReadWaits,
        Self::ReadSent,
        Self::WriteWaits,
        Self::WriteSent,
        Self::Begun,
        Self::Done,
        Self::Failed,
    ];

    pub(super) const fn is_under_way(self) -> bool {
        matches!(self, Self::ReadWaits | Self::ReadSent | Self::WriteWaits | Self::WriteSent | Self::Begun)
    }

    /// The number that programs read.
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

/// The command that a row took last, in one byte: there are many rows. Its progress is in the lowest three bits.
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
        Progress::ALL.get(usize::from(self.0 & 7)).copied().unwrap_or(Progress::None)
    }

    /// It goes on from one of `from` to `to`; else it stays as it is.
    pub(super) fn pass(&mut self, from: &[Progress], to: Progress) {
        if from.contains(&self.progress()) {
            *self = Self::new(self.requester(), to);
        }
    }

    /// A request of the row is sent.
    pub(super) fn sent(&mut self, write: bool) {
        let (waits, sent) = match write {
            false => (Progress::ReadWaits, Progress::ReadSent),
            true => (Progress::WriteWaits, Progress::WriteSent),
        };
        self.pass(&[waits], sent);
    }

    /// A request of the row has ended.
    pub(super) fn ended(&mut self, write: bool, outcome: Result<(), ErrorCode>) {
        let to = if outcome.is_ok() { Progress::Done } else { Progress::Failed };
        self.pass(&[if write { Progress::WriteSent } else { Progress::ReadSent }], to);
    }

    /// The row is not read though it was to be.
    pub(super) fn read_dropped(&mut self) {
        self.pass(&[Progress::ReadWaits], Progress::Failed);
    }

    /// The row's device is left alone.
    pub(super) fn left_alone(&mut self) {
        self.pass(&[Progress::ReadWaits, Progress::WriteWaits], Progress::Failed);
    }

    /// The safe write has come to nothing.
    pub(super) fn abandoned(&mut self) {
        self.pass(&[Progress::Begun], Progress::Failed);
    }

    /// The safe write is finished, whoever has done that.
    pub(super) fn finished(&mut self) {
        self.pass(&[Progress::Begun], Progress::WriteWaits);
    }
}
