//! Who is at the other end of a session, and how it ends.

use super::guard::Foreign;

pub(super) const PROMPT: &str = "mobgate> ";
/// The prompt while the settings in force are not saved.
pub(super) const PROMPT_UNSAVED: &str = "mobgate*> ";
/// Who is at the other end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// A terminal that sends every key: lines are edited here and echoed.
    Echo,
    /// The same, the program's own terminal: Ctrl-C, on an empty line and once more, ends the session with [`Ended::Stopped`].
    Foreground,
    /// A program, a file, or a terminal that edits lines itself.
    Plain,
    /// The same over a network, where anything may come: what is not [`Foreign`] is a session.
    Network,
}

impl Mode {
    /// Whether keys come, and not lines.
    pub(super) fn edits(self) -> bool {
        matches!(self, Self::Echo | Self::Foreground)
    }
}

/// How a session has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// By `exit`, or by the end of input.
    Left {
        /// Some line was answered by an error.
        refused: bool,
    },
    /// By Ctrl-C: the program shall end.
    Stopped,
    /// It was none.
    Foreign(Foreign),
}
