//! Reads a whole configuration text, piece by piece as a store gives it.

use core::fmt;

use heapless::Vec;

use super::problem::{LineError, Problem};
use super::text::apply;
use super::words::Word;
use super::{LINE_BYTES_MAX, Settings};

/// The first bad line of a configuration text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoadError {
    /// The line's number, from 1.
    pub line: u32,
    /// What is wrong in it.
    pub error: LineError,
}

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, {}", self.line, self.error)
    }
}

impl core::error::Error for LoadError {}

/// Takes a text in pieces of any size and applies its lines to settings that start empty.
///
/// After an error the settings are half of what was meant: the caller throws them away.
#[derive(Debug)]
pub struct Loader<'s> {
    settings: &'s mut Settings,
    line: Vec<u8, LINE_BYTES_MAX>,
    number: u32,
}

impl<'s> Loader<'s> {
    /// Empties `settings` and starts to fill them.
    pub fn new(settings: &'s mut Settings) -> Self {
        *settings = Settings::new();
        Self { settings, line: Vec::new(), number: 1 }
    }

    /// Takes the next piece and applies every line that it ends.
    pub fn feed(&mut self, piece: &[u8]) -> Result<(), LoadError> {
        for &byte in piece {
            if byte == b'\n' {
                self.end_line()?;
            } else if self.line.push(byte).is_err() {
                let end = Word { text: "", column: LINE_BYTES_MAX + 1, listed: false };
                return Err(self.error(end.error(Problem::LineTooLong)));
            }
        }
        Ok(())
    }

    /// Applies the last line, which may lack its end.
    pub fn finish(mut self) -> Result<(), LoadError> {
        self.end_line()
    }

    fn end_line(&mut self) -> Result<(), LoadError> {
        let applied = match core::str::from_utf8(&self.line) {
            // The CR of a CR LF is a blank to the line language.
            Ok(line) => apply(self.settings, line),
            Err(error) => {
                let good = self.line.get(..error.valid_up_to()).unwrap_or_default();
                let column = core::str::from_utf8(good).map_or(0, |good| good.chars().count()) + 1;
                Err(Word { text: "", column, listed: false }.error(Problem::NotText))
            }
        };
        applied.map_err(|error| self.error(error))?;
        self.line.clear();
        self.number = self.number.saturating_add(1);
        Ok(())
    }

    fn error(&self, error: LineError) -> LoadError {
        LoadError { line: self.number, error }
    }
}
