//! What a command waits for between its steps, and the resulting events.

use embassy_time::Duration;

use crate::gateway::direct_request::DirectRequestError;
use crate::hal::OpenError;
use crate::language::Wrong;
use crate::settings::LineSettings;

/// What to wait for after a step, once its output is sent.
#[derive(Debug, Clone, Copy)]
pub(super) enum Wait {
    Sent,
    /// Input.
    Key,
    /// This time, or input.
    Pause(Duration),
    /// This time, regardless of input.
    Rest(Duration),
    /// The response to the session's request, or input if that ends it.
    Response {
        typed_ends: bool,
    },
    /// The port of the session's turn to be open with other settings.
    Open {
        line: LineSettings,
        timeout: Duration,
        alone: bool,
    },
    /// The line to be applied, or the settings to be saved or loaded.
    Change,
    Save {
        /// Overwrites changes made to the store by others.
        whatever: bool,
    },
    Load,
    /// The candidate to be put in force, for good or until it is not confirmed in time; or such a commit to be taken back.
    // Left out of images without a candidate.
    #[cfg(feature = "candidate")]
    Commit {
        confirmed: Option<Duration>,
    },
    #[cfg(feature = "candidate")]
    RollBack,
    /// This one of the saved versions to be the candidate, or to be written.
    #[cfg(feature = "candidate")]
    BringBack {
        nth: usize,
    },
    #[cfg(feature = "candidate")]
    Version {
        nth: usize,
    },
    /// The file of a new image.
    Update {
        allow_older: bool,
    },
    /// The password that was typed to be checked, or to become that of a user.
    LogIn,
    Password,
    Reboot,
    /// The end of the command.
    End,
    /// The end of the session.
    Exit,
}

impl Wait {
    /// Whether input is read meanwhile.
    pub(super) fn listens(self) -> bool {
        matches!(self, Self::Key | Self::Pause(_) | Self::Response { typed_ends: true })
    }
}

/// An event that ends waiting.
#[derive(Debug, Clone, Copy)]
pub(super) enum WaitEvent {
    /// The time is over, or there was nothing to wait for.
    Nothing,
    /// There is no further version.
    #[cfg(feature = "candidate")]
    NoVersion,
    Key(u8),
    /// This many bytes of input; 0: the input has ended.
    Typed(usize),
    Response(Result<Duration, DirectRequestError>),
    Opened(Result<(), OpenError>),
}

/// A started command: its further steps, if any, and what to wait for first; an error if its words are wrong.
pub(super) type Begun<J> = Result<(Option<J>, Wait), Wrong>;
