//! How a session talks to its peer, and how it ends.

use core::net::IpAddr;
use core::ops::Range;

use super::guard::Foreign;
use crate::settings::PortId;

pub(super) const PROMPT: &str = "mobgate> ";
/// The prompt while there are unsaved settings.
pub(super) const PROMPT_UNSAVED: &str = "mobgate*> ";
/// The prompt while lines change a candidate.
pub(super) const PROMPT_CANDIDATE: &str = "mobgate(candidate)> ";

/// How a session talks to its peer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode<'u> {
    /// A raw terminal: lines are edited here and echoed.
    Echo,
    /// The program's own raw terminal: Ctrl-C twice on an empty line ends the session with [`Ended::Stopped`].
    Foreground,
    /// A program, a file, or a terminal that edits lines itself.
    Plain,
    /// Lines over a network, from this address and by this port, if it is one of the settings: a [`Foreign`] protocol ends the
    /// session, and a user must log in.
    Network(IpAddr, Option<PortId>),
    /// A user whom SSH has already authenticated.
    User {
        /// The user's name.
        name: &'u str,
        /// Where the user is.
        peer: IpAddr,
        /// The configured port through which the user is connected.
        port: PortId,
        /// Whether a terminal, as with [`Echo`](Self::Echo); else lines, as with [`Plain`](Self::Plain).
        edits: bool,
    },
}

impl<'u> Mode<'u> {
    /// The user who is already authenticated.
    pub(super) fn user(self) -> &'u str {
        match self {
            Self::User { name, .. } => name,
            _ => "",
        }
    }

    /// Where its user is, if not at the gateway.
    pub(super) fn peer(self) -> Option<IpAddr> {
        match self {
            Self::Network(peer, _) | Self::User { peer, .. } => Some(peer),
            _ => None,
        }
    }

    /// The configured port through which the user is connected.
    pub(super) fn port(self) -> Option<PortId> {
        match self {
            Self::Network(_, port) => port,
            Self::User { port, .. } => Some(port),
            _ => None,
        }
    }

    /// What was read behind a line, at `behind` in `chunk`, if it begins a file that goes on up to the end of input.
    pub(super) fn piped<'c>(self, chunk: &'c [u8], behind: &Range<usize>) -> Option<&'c [u8]> {
        chunk.get(behind.clone()).filter(|_| matches!(self, Self::User { edits: false, .. }))
    }

    /// Whether the session edits lines.
    pub(super) fn edits(self) -> bool {
        matches!(self, Self::Echo | Self::Foreground | Self::User { edits: true, .. })
    }
}

/// How a session ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// By `exit`, or by the end of input.
    Left {
        /// Whether a line failed.
        refused: bool,
    },
    /// By Ctrl-C, which also ends the program.
    Stopped,
    /// The peer used another protocol.
    Foreign(Foreign),
}
