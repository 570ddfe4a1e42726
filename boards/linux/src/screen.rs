//! The program's own terminal, shared by console and log: log lines appear above the console's current line.

use std::io::{self, Write as _, stderr, stdout};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rustix::termios::{isatty, tcgetwinsize};

/// Most bytes of a line that are redrawn.
const LINE_BYTES_MAX: usize = 1_024;
const ESCAPE: u8 = 0x1b;

static LAST: Mutex<LastLine> = Mutex::new(LastLine::new());

/// Whether console and log are on one terminal.
pub(crate) fn is_shared() -> bool {
    isatty(io::stdin()) && isatty(stdout()) && isatty(stderr())
}

/// The size of the terminal at standard output as an xterm report, for the console to parse.
pub(crate) fn size_report() -> Option<String> {
    let size = tcgetwinsize(stdout()).ok().filter(|size| size.ws_col > 0)?;
    Some(format!("\x1b[8;{};{}t", size.ws_row, size.ws_col))
}

/// The console's output. Writing may block: a thread does it.
#[derive(Debug)]
pub(crate) struct Screen;

impl io::Write for &Screen {
    fn write(&mut self, text: &[u8]) -> io::Result<usize> {
        let mut last = last();
        stdout().write_all(text)?;
        // Otherwise a log line could come between buffered and visible text.
        stdout().flush()?;
        last.feed(text);
        Ok(text.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Screen {
    /// Writes a log line, and redraws the console's line below it.
    pub(crate) fn log(text: &[u8]) -> io::Result<()> {
        let last = last();
        stderr().write_all(&[b"\r\x1b[K", text, &last.drawn()].concat())
    }

    /// Erases the console's line: input is no longer read.
    pub(crate) fn leave() {
        let mut last = last();
        if !std::mem::replace(&mut *last, LastLine::new()).cells.is_empty() {
            let _ = stderr().write_all(b"\r\x1b[K");
        }
    }
}

fn last() -> MutexGuard<'static, LastLine> {
    LAST.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The contents of the terminal's current line, as far as the console's output tells.
#[derive(Debug)]
struct LastLine {
    cells: Vec<u8>,
    cursor: usize,
    sequence: Sequence,
}

/// Parser state of a control sequence.
#[derive(Debug, Clone, Copy)]
enum Sequence {
    None,
    Escape,
    /// `ESC [` and a number.
    Control(usize),
}

impl LastLine {
    const fn new() -> Self {
        Self { cells: Vec::new(), cursor: 0, sequence: Sequence::None }
    }

    fn feed(&mut self, text: &[u8]) {
        for &byte in text {
            self.sequence = match (self.sequence, byte) {
                (Sequence::Escape, b'[') => Sequence::Control(0),
                (Sequence::Escape, _) => Sequence::None,
                (Sequence::Control(number), b'0'..=b'9') => {
                    Sequence::Control((number * 10 + usize::from(byte - b'0')).min(LINE_BYTES_MAX))
                }
                (Sequence::Control(number), _) => {
                    self.control(byte, number);
                    Sequence::None
                }
                (Sequence::None, ESCAPE) => Sequence::Escape,
                (Sequence::None, _) => {
                    self.plain(byte);
                    Sequence::None
                }
            };
        }
    }

    fn control(&mut self, end: u8, number: usize) {
        match end {
            b'K' => self.cells.truncate(self.cursor),
            b'C' => self.cursor += number.max(1),
            // Clears the screen.
            b'J' => self.cells.clear(),
            _ => {}
        }
    }

    fn plain(&mut self, byte: u8) {
        match byte {
            b'\n' => (self.cells, self.cursor) = (Vec::new(), 0),
            b'\r' => self.cursor = 0,
            _ if byte.is_ascii_control() || self.cursor >= LINE_BYTES_MAX => {}
            _ => {
                self.cells.resize(self.cells.len().max(self.cursor + 1), b' ');
                self.cells[self.cursor] = byte;
                self.cursor += 1;
            }
        }
    }

    /// The bytes that redraw it on an empty line.
    fn drawn(&self) -> Vec<u8> {
        let mut drawn = self.cells.clone();
        if self.cursor < self.cells.len() {
            drawn.push(b'\r');
            if self.cursor > 0 {
                drawn.extend(format!("\x1b[{}C", self.cursor).bytes());
            }
        }
        drawn
    }
}

#[cfg(test)]
mod tests {
    use super::LastLine;

    fn drawn(written: &str) -> String {
        let mut last = LastLine::new();
        last.feed(written.as_bytes());
        String::from_utf8(last.drawn()).unwrap()
    }

    #[test]
    fn the_prompt_and_what_is_typed_are_drawn_with_the_cursor_in_its_place() {
        assert_eq!(drawn("any\r\n\r> \x1b[K\r\x1b[2Cshow"), "> show");
        assert_eq!(drawn("> show\r> show\x1b[K\r\x1b[4C"), "> show\r\x1b[4C");
        assert_eq!(drawn("> show\r> sho\x1b[K\r\x1b[5C"), "> sho");
        assert_eq!(drawn("> show\r"), "> show\r");
        assert_eq!(drawn("> show\x07\r\n"), "");
        assert_eq!(drawn("old\x1b[H\x1b[2J\r> \x1b[K"), "> ");
    }
}
