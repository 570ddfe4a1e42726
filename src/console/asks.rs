//! How the next line is interpreted: a command, a name or a password.

use core::ops::RangeInclusive;

use heapless::String;

use super::mode::Mode;
use crate::settings::{Name, USERS};

/// Bytes of a password.
pub const PASSWORD_BYTES: RangeInclusive<usize> = 8..=64;

/// A password's text.
pub(crate) type Password = String<{ *PASSWORD_BYTES.end() }>;

/// How the next line is interpreted.
#[derive(Debug, Default)]
pub(super) enum Asks {
    #[default]
    Command,
    /// User name, then password.
    User,
    Password(Name),
    /// The new password of a user, then its repetition.
    New(Name),
    Again(Name, Password),
}

impl Asks {
    /// The first state of a session.
    pub(super) fn first(mode: Mode<'_>) -> Self {
        if matches!(mode, Mode::Network(..)) { Self::User } else { Self::Command }
    }

    /// The prompt; `None`: that of commands.
    pub(super) fn prompt(&self) -> Option<&'static str> {
        if !USERS {
            return None;
        }
        Some(match self {
            Self::Command => return None,
            Self::User => "user: ",
            Self::Password(_) => "password: ",
            Self::New(_) => "new password: ",
            Self::Again(..) => "again: ",
        })
    }

    /// Whether log-in is still pending.
    pub(super) fn is_log_in(&self) -> bool {
        matches!(self, Self::User | Self::Password(_))
    }

    /// Whether the line must not be shown.
    pub(super) fn is_secret(&self) -> bool {
        USERS && !matches!(self, Self::Command | Self::User)
    }
}
