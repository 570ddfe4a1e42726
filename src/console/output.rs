//! What a command has written and the stream has not taken yet.

use core::fmt::{self, Write as _};

use heapless::String;

use super::wait::Wait;
use crate::settings::LINE_BYTES_MAX;

/// Room for the longest line of output: a line of settings, or a rule's row in a table, and some more.
const OUTPUT_BYTES_MAX: usize = LINE_BYTES_MAX + 128;

/// What came of a place in a table, of which the first one has the heading: nothing behind the last one. A place that has no row at
/// the moment writes nothing.
pub(super) type Written = Option<fmt::Result>;

pub(super) const NO_ROW: Written = Some(Ok(()));

/// Text for the stream.
pub(super) struct Output {
    pub(super) text: String<OUTPUT_BYTES_MAX>,
    line_end: &'static str,
}

impl Output {
    pub(super) fn new(line_end: &'static str) -> Self {
        Self { text: String::new(), line_end }
    }

    /// Writes `text`, and does not end the line.
    pub(super) fn put(&mut self, text: fmt::Arguments<'_>) {
        // Of what has no room the end is missing.
        let _ = self.text.write_fmt(text);
    }

    /// Writes `text` and ends the line.
    pub(super) fn line(&mut self, text: fmt::Arguments<'_>) {
        self.put(text);
        self.end();
    }

    /// Ends the line.
    pub(super) fn end(&mut self) {
        while self.text.ends_with(' ') {
            self.text.pop();
        }
        while self.text.push_str(self.line_end).is_err() {
            self.text.pop();
        }
    }

    /// Writes the next row that there is of a table, from `place` on.
    pub(super) fn row(
        &mut self,
        place: &mut usize,
        write: &mut dyn FnMut(usize, &mut dyn fmt::Write) -> Written,
    ) -> Wait {
        let start = self.text.len();
        while write(*place, &mut self.text).is_some() {
            *place += 1;
            if self.text.len() > start {
                self.end();
                return Wait::Sent;
            }
        }
        Wait::End
    }
}
