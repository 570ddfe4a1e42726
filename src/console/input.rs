//! Splits input into lines.

use core::fmt;

use super::asks::Asks;
use super::editor::{Editor, Event};
use super::guard::{Foreign, Guard};
use super::keys::{Key, Keys, Stripped};
use super::mode::{Mode, PROMPT};
use super::output::Output;
use crate::language::{LineBuffer, LineError};

/// Assembles lines.
// One per session, and boards use the larger variant.
#[allow(clippy::large_enum_variant)]
pub(super) enum Input {
    /// Typed at a terminal.
    Keys(Editor),
    /// Lines of text, with a guard if they come over a network. Escape sequences among them are ignored.
    Text(LineBuffer, Keys, Option<Guard>),
}

/// The effect of a byte.
pub(super) enum Typed {
    /// The line is incomplete.
    More,
    /// The line is complete.
    Line,
    /// The line is invalid.
    Wrong(LineError),
    /// The terminal reports its number of columns.
    Columns(usize),
    /// Complete the word at the cursor.
    Complete,
    /// End the session.
    Leave,
    /// End the program.
    Stop,
    /// The peer uses another protocol.
    Foreign(Foreign),
}

impl Input {
    pub(super) fn new(mode: Mode<'_>) -> Self {
        match mode {
            Mode::Echo | Mode::User { edits: true, .. } => Self::Keys(Editor::new(PROMPT, false)),
            Mode::Foreground => Self::Keys(Editor::new(PROMPT, true)),
            Mode::Plain | Mode::User { edits: false, .. } => {
                Self::Text(LineBuffer::default(), Keys::default(), None)
            }
            Mode::Network(..) => Self::Text(LineBuffer::default(), Keys::default(), Some(Guard::default())),
        }
    }

    /// Starts an empty line; `prompt` is that of commands.
    pub(super) fn start(&mut self, prompt: &'static str, asks: &Asks, out: &mut Output) {
        match self {
            Self::Keys(editor) => {
                editor.set_prompt(asks.prompt().unwrap_or(prompt), asks.is_secret());
                editor.start();
                editor.echo_to(out);
            }
            Self::Text(line, _, guard) => {
                line.clear();
                // Piped text and local programs need no prompt.
                if let (Some(prompt), Some(_)) = (asks.prompt(), guard) {
                    out.put(format_args!("{prompt}"));
                }
            }
        }
    }

    /// Takes a byte.
    pub(super) fn feed(&mut self, byte: u8, out: &mut Output) -> Typed {
        match self {
            Self::Keys(editor) => {
                let event = editor.feed(byte);
                editor.echo_to(out);
                match event {
                    Event::Editing => Typed::More,
                    Event::Line => Typed::Line,
                    Event::LineTooLong => Typed::Wrong(LineError::too_long()),
                    Event::Complete => Typed::Complete,
                    Event::Columns(columns) => Typed::Columns(columns),
                    Event::Leave => Typed::Leave,
                    Event::Stop => Typed::Stop,
                }
            }
            Self::Text(line, keys, guard) => {
                if let Some(foreign) = guard.as_mut().and_then(|guard| guard.feed(byte)) {
                    return Typed::Foreign(foreign);
                }
                match keys.strip(byte) {
                    Stripped::Text if line.feed(byte) => line.text().err().map_or(Typed::Line, Typed::Wrong),
                    Stripped::Key(Key::Columns(columns)) => Typed::Columns(columns.into()),
                    _ => Typed::More,
                }
            }
        }
    }

    /// Handles the end of input.
    pub(super) fn end(&mut self, out: &mut Output) -> Typed {
        match self {
            Self::Keys(_) => Typed::Leave,
            // The last line may lack its end.
            Self::Text(..) => self.feed(b'\n', out),
        }
    }

    /// Replaces the line by the output of `write`.
    pub(super) fn replace(&mut self, write: impl FnOnce(&mut dyn fmt::Write)) {
        // Only sessions with an editor offer lines.
        if let Self::Keys(editor) = self {
            editor.replace(write);
        }
    }

    /// The complete line.
    pub(super) fn line(&self) -> &str {
        match self {
            Self::Keys(editor) => editor.line(),
            // Neither byte of a line end belongs to the line.
            Self::Text(line, ..) => line.text().unwrap_or_default().trim_end_matches('\r'),
        }
    }
}
