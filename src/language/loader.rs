//! Reads a whole configuration text, in pieces of any size.

use core::fmt;

use super::apply::apply;
use super::line::LineBuffer;
use super::problem::LineError;
use crate::settings::Settings;

/// The first bad line of a configuration text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoadError {
    /// The line's number, from 1.
    pub line: u32,
    /// The error in it.
    pub error: LineError,
}

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, {}", self.line, self.error)
    }
}

impl core::error::Error for LoadError {}

/// The byte-order mark that some editors write.
const BYTE_ORDER_MARK: &[u8] = "\u{feff}".as_bytes();

/// Called for each line with its number, and the settings after it.
pub(crate) type Observer<'l> = dyn FnMut(u32, &str, &Settings) + 'l;

/// Reads a text in pieces and applies its lines to settings that start empty.
///
/// After an error the settings are incomplete and must be discarded.
pub struct Loader<'s> {
    settings: &'s mut Settings,
    line: &'s mut LineBuffer,
    number: u32,
    observer: Option<&'s mut Observer<'s>>,
}

impl<'s> Loader<'s> {
    /// Clears `settings` and starts to fill them. Each line is assembled in `line`.
    pub fn new(settings: &'s mut Settings, line: &'s mut LineBuffer) -> Self {
        settings.clear();
        line.clear();
        Self { settings, line, number: 1, observer: None }
    }

    /// Calls `observer` for every line.
    pub(crate) fn with_observer(self, observer: &'s mut Observer<'s>) -> Self {
        Self { observer: Some(observer), ..self }
    }

    /// Reads the next piece and applies every line that it completes.
    pub fn feed(&mut self, piece: &[u8]) -> Result<(), LoadError> {
        for &byte in piece {
            if self.line.feed(byte) {
                self.end_line()?;
            } else if self.number == 1 && self.line.is(BYTE_ORDER_MARK) {
                self.line.clear();
            }
        }
        Ok(())
    }

    /// Applies the last line, which may lack a line end.
    pub fn finish(mut self) -> Result<(), LoadError> {
        self.end_line()
    }

    fn end_line(&mut self) -> Result<(), LoadError> {
        let applied = self.line.text().and_then(|line| apply(self.settings, line));
        applied.map_err(|error| LoadError { line: self.number, error })?;
        if let (Some(observer), Ok(line)) = (&mut self.observer, self.line.text()) {
            observer(self.number, line, self.settings);
        }
        self.line.clear();
        self.number = self.number.saturating_add(1);
        Ok(())
    }
}
