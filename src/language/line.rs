//! Splits bytes into lines of bounded length.

use core::fmt;

use heapless::Vec;

use super::problem::{LineError, Problem};
use crate::settings::LINE_BYTES_MAX;

/// The line being assembled: memory for the longest.
#[derive(Debug, Default)]
pub struct LineBuffer {
    /// A line that is saved has its end, too.
    bytes: Vec<u8, { LINE_BYTES_MAX + 1 }>,
    /// Whether bytes had to be dropped.
    cut: bool,
}

impl LineBuffer {
    /// An empty line.
    pub(crate) const fn new() -> Self {
        Self { bytes: Vec::new(), cut: false }
    }

    /// Adds a byte; true when it ends the line. The CR of a CR LF stays; it counts as a blank.
    pub(crate) fn feed(&mut self, byte: u8) -> bool {
        if byte == b'\n' {
            return true;
        }
        self.cut |= self.bytes.len() >= LINE_BYTES_MAX;
        if !self.cut {
            // Fits.
            let _ = self.bytes.push(byte);
        }
        false
    }

    /// The line, if it is complete and valid text.
    pub(crate) fn text(&self) -> Result<&str, LineError> {
        if self.cut {
            return Err(LineError::too_long());
        }
        core::str::from_utf8(&self.bytes).map_err(|error| {
            let good = self.bytes.get(..error.valid_up_to()).unwrap_or_default();
            let column = core::str::from_utf8(good).map_or(0, |good| good.chars().count()) + 1;
            LineError::new(column, "", Problem::NotText)
        })
    }

    /// The bytes so far.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Whether the line so far is `bytes`.
    pub(crate) fn is(&self, bytes: &[u8]) -> bool {
        self.bytes == bytes
    }

    /// Starts the next line.
    pub(crate) fn clear(&mut self) {
        self.bytes.clear();
        self.cut = false;
    }
}

/// Appends text that fits.
impl fmt::Write for LineBuffer {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let written = self.bytes.extend_from_slice(text.as_bytes());
        self.cut |= written.is_err();
        written.map_err(|_| fmt::Error)
    }
}
