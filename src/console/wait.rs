//! What a command waits for between its steps, and what comes of it.

use embassy_time::Duration;

use crate::gateway::direct_request::DirectRequestError;
use crate::hal::OpenError;
use crate::language::Wrong;
use crate::settings::LineSettings;

/// What is waited for behind a step, when what it has written is sent.
#[derive(Debug, Clone, Copy)]
pub(super) enum Wait {
    /// Nothing more.
    Sent,
    /// A key, or text.
    Key,
    /// So long, or that something is typed.
    Pause(Duration),
    /// So long, whatever is typed.
    Rest(Duration),
    /// The response to the session's question, or that something is typed if that ends it.
    Answer {
        typed_ends: bool,
    },
    /// That the port of the session's turn is open with other settings.
    Open {
        line: LineSettings,
        timeout: Duration,
        alone: bool,
    },
    /// That the line has changed the settings, that they are saved, or taken over.
    Change,
    Save {
        /// What somebody else has written there meanwhile is written over.
        whatever: bool,
    },
    Load,
    Reboot,
    /// The command is done.
    End,
    /// The session is done.
    Exit,
}

impl Wait {
    /// Whether it matters what is typed meanwhile.
    pub(super) fn listens(self) -> bool {
        matches!(self, Self::Key | Self::Pause(_) | Self::Answer { typed_ends: true })
    }
}

/// What came of waiting.
#[derive(Debug, Clone, Copy)]
pub(super) enum WaitEvent {
    /// The time is over, or there was nothing to wait for.
    Nothing,
    Key(u8),
    /// So many bytes; 0: the input has ended.
    Typed(usize),
    Answer(Result<Duration, DirectRequestError>),
    Opened(Result<(), OpenError>),
}

/// What the words of a line begin: a command that takes more steps, if it does, and what is waited for first; nothing if they are
/// wrong.
pub(super) type Begun<J> = Result<(Option<J>, Wait), Wrong>;
