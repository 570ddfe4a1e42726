//! What is typed or piped in, as lines.

use core::fmt;

use super::editor::{Editor, Event};
use super::guard::{Foreign, Guard};
use super::keys::{Key, Keys, Stripped};
use super::mode::{Mode, PROMPT};
use super::output::Output;
use crate::language::{LineBuffer, LineError};

/// Where lines are put together.
// There is one in a session, and the larger one is the one that boards have.
#[allow(clippy::large_enum_variant)]
pub(super) enum Input {
    /// By a person at a terminal.
    Keys(Editor),
    /// Out of lines of text, which come over a network if they are watched. Keys that a terminal sends among them say nothing.
    Text(LineBuffer, Keys, Option<Guard>),
}

/// What a byte made of the line.
pub(super) enum Typed {
    /// It is not ended.
    More,
    /// It is to be run.
    Line,
    /// It cannot be run.
    Wrong(LineError),
    /// The terminal has so many columns.
    Columns(usize),
    /// The word at the cursor is to be completed.
    Complete,
    /// The session shall end.
    Leave,
    /// The program shall end.
    Stop,
    /// This is no session.
    Foreign(Foreign),
}

impl Input {
    pub(super) fn new(mode: Mode) -> Self {
        match mode {
            Mode::Echo => Self::Keys(Editor::new(PROMPT, false)),
            Mode::Foreground => Self::Keys(Editor::new(PROMPT, true)),
            Mode::Plain => Self::Text(LineBuffer::default(), Keys::default(), None),
            Mode::Network => Self::Text(LineBuffer::default(), Keys::default(), Some(Guard::default())),
        }
    }

    /// Starts an empty line.
    pub(super) fn start(&mut self, prompt: &'static str, out: &mut Output) {
        match self {
            Self::Keys(editor) => {
                editor.set_prompt(prompt);
                editor.start();
                editor.echo_to(out);
            }
            Self::Text(line, ..) => line.clear(),
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

    /// The input has ended.
    pub(super) fn end(&mut self, out: &mut Output) -> Typed {
        match self {
            Self::Keys(_) => Typed::Leave,
            // The last line may lack its end.
            Self::Text(..) => self.feed(b'\n', out),
        }
    }

    /// Puts what `write` writes in place of the line.
    pub(super) fn replace(&mut self, write: impl FnOnce(&mut dyn fmt::Write)) {
        // Only a person is asked.
        if let Self::Keys(editor) = self {
            editor.replace(write);
        }
    }

    /// The line that is to be run.
    pub(super) fn line(&self) -> &str {
        match self {
            Self::Keys(editor) => editor.line(),
            Self::Text(line, ..) => line.text().unwrap_or_default(),
        }
    }
}
