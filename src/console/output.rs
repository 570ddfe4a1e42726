//! Output that is not yet written to the stream.

use core::fmt::{self, Write as _};

use heapless::String;

use crate::settings::LINE_BYTES_MAX;

/// Fits the longest line of output: a line of settings, or a rule's row in a table, with a margin.
const OUTPUT_BYTES_MAX: usize = LINE_BYTES_MAX + 128;

/// The result of writing one place of a table; `None` after the last place. The first place is the heading. A place without a row
/// writes nothing.
pub(crate) type Written = Option<fmt::Result>;

pub(super) const NO_ROW: Written = Some(Ok(()));

/// Columns until the terminal reports its own.
pub(super) const COLUMNS: usize = 80;
/// Minimum width of text that continues below its first line.
const ROOM_MIN: usize = 20;
/// Indentation of continued text otherwise.
const INDENT: usize = 4;

/// Discards text.
pub(super) struct Nowhere;

impl fmt::Write for Nowhere {
    fn write_str(&mut self, _: &str) -> fmt::Result {
        Ok(())
    }
}

/// Text for the stream.
pub(super) struct Output {
    pub(super) text: String<OUTPUT_BYTES_MAX>,
    line_end: &'static str,
    /// Columns of the terminal; `None`: lines are not wrapped.
    pub(super) columns: Option<usize>,
    /// Columns of the current line already sent.
    sent: usize,
}

impl Output {
    pub(super) fn new(line_end: &'static str, columns: Option<usize>) -> Self {
        Self { text: String::new(), line_end, columns, sent: 0 }
    }

    /// Writes `text` without a line end.
    pub(super) fn put(&mut self, text: fmt::Arguments<'_>) {
        // Text that does not fit is truncated.
        let _ = self.text.write_fmt(text);
    }

    /// Writes `text` and a line end, wrapped to the terminal.
    pub(super) fn line(&mut self, text: fmt::Arguments<'_>) {
        self.put(text);
        self.fold(INDENT);
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

    /// Clears the text after it was sent.
    pub(super) fn clear(&mut self) {
        self.sent = self.column();
        self.text.clear();
    }

    /// Columns of the current line.
    pub(super) fn column(&self) -> usize {
        let (start, sent) = self.line_start();
        sent + self.text.get(start..).unwrap_or_default().chars().count()
    }

    /// Where the current line starts in the text, and its columns already sent.
    fn line_start(&self) -> (usize, usize) {
        let last = self.text.bytes().rposition(|byte| byte == b'\n');
        last.map_or((0, self.sent), |at| (at + 1, 0))
    }

    /// Continues on the next line.
    pub(super) fn indent(&mut self) {
        self.end();
        self.put(format_args!("{:INDENT$}", ""));
    }

    /// Whether `count` more columns fit.
    pub(super) fn has_room(&self, count: usize) -> bool {
        self.columns.is_none_or(|columns| self.column() + count <= columns)
    }

    /// Wraps the current line at blanks to the terminal's width. It continues at column `hang` where that fits.
    pub(super) fn fold(&mut self, hang: usize) {
        let Some(columns) = self.columns.filter(|columns| self.column() > *columns) else { return };
        let hang = if hang + ROOM_MIN > columns { INDENT } else { hang };
        let (start, sent) = self.line_start();
        let line = self.text.clone();
        self.text.truncate(start);
        let mut column = sent;
        for word in line.get(start..).unwrap_or_default().split_inclusive(' ') {
            if column > hang && column + word.trim_ascii_end().chars().count() > columns {
                self.end();
                self.put(format_args!("{:hang$}", ""));
                column = hang;
            }
            self.put(format_args!("{word}"));
            column += word.chars().count();
        }
    }
}
