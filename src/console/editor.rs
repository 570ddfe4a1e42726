//! The line editor: a state machine that takes bytes from a terminal and returns complete lines and echo.
//!
//! Written by hand because the maintained crates (noline, embedded-cli) use older versions of embedded-io, or have no async API.
//! Lines are ASCII, so a byte is a column.

use core::fmt::Write;

use heapless::{String, Vec};

use super::history::History;
use super::keys::{Key, Keys};
use super::output::{COLUMNS, Output};
use crate::settings::LINE_BYTES_MAX;

/// Most bytes of echo for one key.
const ECHO_BYTES_MAX: usize = COLUMNS_MAX + 32;
/// Columns used. A longer line scrolls sideways, because terminals wrap differently.
const COLUMNS_MIN: usize = 20;
const COLUMNS_MAX: usize = 160;
const BELL: char = '\x07';
/// Shown at the first of two Ctrl-C.
const STOP_HINT: &str = "press Ctrl-C again to stop the gateway\r\n";

/// What the owner must do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Event {
    Editing,
    /// Run [`Editor::line`], then call [`Editor::start`].
    Line,
    /// Report that the line was longer than [`LINE_BYTES_MAX`], then call [`Editor::start`].
    LineTooLong,
    /// Complete the word at the cursor.
    Complete,
    /// The terminal has this many columns.
    Columns(usize),
    /// End the session.
    Leave,
    /// End the program.
    Stop,
}

/// The line being edited.
pub(super) struct Editor {
    prompt: &'static str,
    /// The line is neither shown nor kept in the history.
    secret: bool,
    columns: usize,
    /// Set if two Ctrl-C on an empty line end the program; whether the first was received.
    stops: bool,
    stop_asked: bool,
    keys: Keys,
    line: Vec<u8, LINE_BYTES_MAX>,
    cursor: usize,
    /// A key did not fit: the line differs from what was typed and must not run.
    cut: bool,
    history: History,
    /// Position in the history; 0 is the new line, which is stored as the newest while older ones are shown.
    back: usize,
    /// To be written to the terminal after each key.
    echo: String<ECHO_BYTES_MAX>,
}

impl Editor {
    /// An editor that has not shown its `prompt` yet. With `stops`, Ctrl-C may end the program.
    pub(super) fn new(prompt: &'static str, stops: bool) -> Self {
        Self {
            prompt,
            secret: false,
            columns: COLUMNS,
            stops,
            stop_asked: false,
            keys: Keys::default(),
            line: Vec::new(),
            cursor: 0,
            cut: false,
            history: History::default(),
            back: 0,
            echo: String::new(),
        }
    }

    /// The current line.
    pub(super) fn line(&self) -> &str {
        text(&self.line)
    }

    /// Replaces the line by the output of `write`, without showing it.
    pub(super) fn replace(&mut self, write: impl FnOnce(&mut dyn core::fmt::Write)) {
        self.line.clear();
        write(&mut self.line);
    }

    /// The part of the line before the cursor.
    pub(super) fn before_cursor(&self) -> &str {
        text(self.line.get(..self.cursor).unwrap_or_default())
    }

    /// Sets the prompt from the next line on, and whether that is a secret.
    pub(super) fn set_prompt(&mut self, prompt: &'static str, secret: bool) {
        (self.prompt, self.secret) = (prompt, secret);
    }

    /// Starts an empty line.
    pub(super) fn start(&mut self) {
        self.forget_draft();
        self.line.clear();
        self.cursor = 0;
        self.cut = false;
        self.redraw();
    }

    /// Writes the pending echo.
    pub(super) fn echo_to(&mut self, out: &mut Output) {
        out.put(format_args!("{}", self.echo));
        self.echo.clear();
    }

    /// Takes a byte.
    pub(super) fn feed(&mut self, byte: u8) -> Event {
        let Some(key) = self.keys.feed(byte) else { return Event::Editing };
        let stop_asked = core::mem::take(&mut self.stop_asked);
        match key {
            Key::Insert(byte) => self.insert(byte),
            Key::Enter => return self.enter(),
            Key::Left => self.move_to(self.cursor.checked_sub(1)),
            Key::Right => self.move_to(Some(self.cursor + 1)),
            Key::Home => self.move_to(Some(0)),
            Key::End => self.move_to(Some(self.line.len())),
            Key::Earlier => self.browse(Some(self.back + 1)),
            Key::Later => self.browse(self.back.checked_sub(1)),
            Key::DeleteLeft => self.delete(self.cursor.saturating_sub(1), self.cursor),
            Key::Leave if self.line.is_empty() => return Event::Leave,
            Key::DeleteRight | Key::Leave => self.delete(self.cursor, self.cursor + 1),
            Key::DeleteWord => {
                let before = self.before_cursor().trim_ascii_end();
                let last = before.bytes().rposition(|byte| byte.is_ascii_whitespace());
                self.delete(last.map_or(0, |at| at + 1), self.cursor);
            }
            Key::DeleteToStart => self.delete(0, self.cursor),
            Key::DeleteToEnd => self.delete(self.cursor, self.line.len()),
            Key::ClearScreen => {
                self.print("\x1b[H\x1b[2J");
                self.redraw();
            }
            Key::Complete => return Event::Complete,
            Key::Columns(columns) => {
                let columns = usize::from(columns);
                self.columns = columns.clamp(COLUMNS_MIN, COLUMNS_MAX);
                self.redraw();
                return Event::Columns(columns);
            }
            Key::Cancel if stop_asked => {
                self.print("^C\r\n");
                return Event::Stop;
            }
            Key::Cancel => {
                self.print("^C\r\n");
                if self.stops && self.line.is_empty() {
                    self.stop_asked = true;
                    self.print(STOP_HINT);
                }
                self.start();
            }
            Key::Unknown => self.bell(),
        }
        Event::Editing
    }

    /// Inserts `text` at the cursor, as if it were typed.
    pub(super) fn insert_text(&mut self, text: &str) {
        for byte in text.bytes() {
            // Only the echo of one key is bounded.
            self.echo.clear();
            self.insert(byte);
        }
        self.echo.clear();
        self.redraw();
    }

    /// Rings the terminal's bell.
    pub(super) fn bell(&mut self) {
        let _ = self.echo.push(BELL);
    }

    /// Redraws prompt and line, and places the cursor.
    pub(super) fn redraw(&mut self) {
        let room = self.columns - 1 - self.prompt.len().min(self.columns / 2);
        let (line, cursor) = if self.secret { (&[][..], 0) } else { (self.line.as_slice(), self.cursor) };
        let first = cursor.saturating_sub(room);
        let last = line.len().min(first + room);
        let shown = text(line.get(first..last).unwrap_or_default());
        let column = self.prompt.len() + cursor - first;
        let _ = write!(self.echo, "\r{}{shown}\x1b[K\r\x1b[{column}C", self.prompt);
    }

    fn enter(&mut self) -> Event {
        self.print("\r\n");
        if self.cut {
            return Event::LineTooLong;
        }
        self.forget_draft();
        if !self.secret {
            self.history.push(&self.line);
        }
        Event::Line
    }

    fn insert(&mut self, byte: u8) {
        if self.line.insert(self.cursor.min(self.line.len()), byte).is_err() {
            self.cut = true;
            return self.bell();
        }
        self.cursor += 1;
        let fits = self.prompt.len() + self.line.len() < self.columns;
        if fits && self.cursor == self.line.len() && !self.secret {
            let _ = self.echo.push(char::from(byte));
        } else {
            self.redraw();
        }
    }

    fn delete(&mut self, from: usize, to: usize) {
        let to = to.min(self.line.len());
        if from >= to {
            return self.bell();
        }
        self.line.copy_within(to.., from);
        self.line.truncate(self.line.len() - (to - from));
        self.cursor = from;
        if self.line.is_empty() {
            // The overflow belonged to the deleted line.
            self.cut = false;
        }
        self.redraw();
    }

    fn move_to(&mut self, cursor: Option<usize>) {
        match cursor.filter(|&cursor| cursor <= self.line.len()) {
            Some(cursor) => {
                self.cursor = cursor;
                self.redraw();
            }
            None => self.bell(),
        }
    }

    /// Shows the line `back` lines ago.
    fn browse(&mut self, back: Option<usize>) {
        let Some(back) = back.filter(|_| !self.secret) else { return self.bell() };
        if self.back == 0 {
            self.history.keep(&self.line);
        }
        // The new line is the newest.
        match self.history.back(back + 1).map(Vec::from_slice) {
            Some(Ok(line)) => {
                self.back = back;
                self.cursor = line.len();
                self.line = line;
                self.redraw();
            }
            _ => self.bell(),
        }
        if self.back == 0 {
            self.history.forget();
        }
    }

    fn forget_draft(&mut self) {
        if self.back > 0 {
            self.history.forget();
            self.back = 0;
        }
    }

    fn print(&mut self, text: &str) {
        let _ = self.echo.push_str(text);
    }
}

/// Only printable ASCII is inserted.
fn text(bytes: &[u8]) -> &str {
    core::str::from_utf8(bytes).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::String;

    use super::*;

    /// Types `bytes`; returns the line and the cursor.
    fn typed(bytes: &str) -> (String, usize) {
        let mut editor = Editor::new("> ", false);
        for &byte in bytes.as_bytes() {
            if editor.feed(byte) == Event::Line {
                editor.start();
            }
            editor.echo.clear();
        }
        (editor.line().into(), editor.cursor)
    }

    #[test]
    fn keys_edit_the_line_at_the_cursor() {
        assert_eq!(typed("abc"), ("abc".into(), 3));
        assert_eq!(typed("abc\x1b[D\x1b[DX"), ("aXbc".into(), 2));
        assert_eq!(typed("abc\x01\x7fX\x05Y"), ("XabcY".into(), 5));
        assert_eq!(typed("abc\x1b[H\x1b[3~"), ("bc".into(), 0));
        assert_eq!(typed("abc\x1b[D\x08"), ("ac".into(), 1));
        assert_eq!(typed("one two  \x17"), ("one ".into(), 4));
        assert_eq!(typed("one two\x02\x02\x0b"), ("one t".into(), 5));
        assert_eq!(typed("one two\x02\x02\x15"), ("wo".into(), 0));
        assert_eq!(typed("abc\x03d"), ("d".into(), 1));
        assert_eq!(typed("\x1b[C\x1b[D\x7f\x0b\x1b[B"), ("".into(), 0));
    }

    #[test]
    fn arrows_browse_the_history_and_come_back_to_the_new_line() {
        assert_eq!(typed("one\rtwo\r\x1b[A").0, "two");
        assert_eq!(typed("one\rtwo\r\x1b[A\x1b[A\x1b[A").0, "one");
        assert_eq!(typed("one\rtwo\rnew\x1b[A\x1b[A\x1b[B\x1b[B").0, "new");
        assert_eq!(typed("one\r\x1b[Ax\x1b[A\x1b[B").0, "", "an edited old line is not kept");
    }

    #[test]
    fn a_line_that_had_no_room_does_not_run() {
        let mut editor = Editor::new("> ", false);
        let feed = |editor: &mut Editor, byte| {
            let event = editor.feed(byte);
            editor.echo.clear();
            event
        };
        for _ in 0..10_000 {
            assert_eq!(feed(&mut editor, b'x'), Event::Editing);
        }
        feed(&mut editor, 0x7f);
        assert_eq!(feed(&mut editor, b'\r'), Event::LineTooLong);
        editor.start();
        editor.echo.clear();
        feed(&mut editor, b'y');
        assert_eq!(feed(&mut editor, b'\r'), Event::Line);
        assert_eq!(editor.line(), "y");
    }

    #[test]
    fn typing_at_the_end_echoes_only_the_key_and_elsewhere_redraws() {
        let mut editor = Editor::new("> ", false);
        editor.start();
        assert_eq!(editor.echo.as_str(), "\r> \x1b[K\r\x1b[2C");
        editor.echo.clear();
        editor.feed(b'a');
        assert_eq!(editor.echo.as_str(), "a");
        editor.echo.clear();
        for byte in *b"\x1b[D" {
            editor.feed(byte);
        }
        assert_eq!(editor.echo.as_str(), "\r> a\x1b[K\r\x1b[2C");
    }

    #[test]
    fn a_long_line_scrolls_so_that_the_cursor_is_on_the_screen() {
        let mut editor = Editor::new("> ", false);
        for n in 0..LINE_BYTES_MAX {
            editor.echo.clear();
            editor.feed(b'a' + (n % 26) as u8);
            assert!(editor.echo.len() < ECHO_BYTES_MAX - 60, "the echo fits");
        }
        assert!(editor.echo.ends_with("\r\x1b[79C"));
    }

    #[test]
    fn ctrl_c_clears_a_line_asks_on_an_empty_one_and_stops_only_then() {
        let mut editor = Editor::new("> ", true);
        let feed = |editor: &mut Editor, bytes: &[u8]| {
            editor.echo.clear();
            bytes.iter().map(|byte| editor.feed(*byte)).last()
        };
        assert_eq!(feed(&mut editor, b"abc\x03"), Some(Event::Editing));
        assert!(!editor.echo.contains("again") && editor.line().is_empty());
        assert_eq!(feed(&mut editor, b"\x03"), Some(Event::Editing));
        assert!(editor.echo.contains("press Ctrl-C again to stop the gateway"));
        // Any other key cancels it.
        assert_eq!(feed(&mut editor, b"a\x7f\x03"), Some(Event::Editing));
        assert_eq!(feed(&mut editor, b"\x03"), Some(Event::Stop));
        let mut joined = Editor::new("> ", false);
        assert_eq!(feed(&mut joined, b"\x03\x03\x03"), Some(Event::Editing));
    }

    #[test]
    fn ctrl_d_leaves_only_on_an_empty_line() {
        let mut editor = Editor::new("> ", false);
        assert_eq!(editor.feed(4), Event::Leave);
        editor.feed(b'a');
        assert_eq!(editor.feed(4), Event::Editing);
    }
}
