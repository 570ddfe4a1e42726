//! What a command has written and the stream has not taken yet.

use core::fmt::{self, Write as _};

use heapless::String;

use crate::settings::LINE_BYTES_MAX;

/// Room for the longest line of output: a line of settings, or a rule's row in a table, and some more.
const OUTPUT_BYTES_MAX: usize = LINE_BYTES_MAX + 128;

/// What came of a place in a table, of which the first one has the heading: nothing behind the last one. A place that has no row at
/// the moment writes nothing.
pub(super) type Written = Option<fmt::Result>;

pub(super) const NO_ROW: Written = Some(Ok(()));

/// Columns of a terminal that has not told how many it has.
pub(super) const COLUMNS: usize = 80;
/// Least room for text that goes on in the next line below where it began.
const ROOM_MIN: usize = 20;
/// Where it goes on without that room.
const INDENT: usize = 4;

/// Text for the stream.
pub(super) struct Output {
    pub(super) text: String<OUTPUT_BYTES_MAX>,
    line_end: &'static str,
    /// Columns of the terminal; none: nobody looks, and lines stay whole.
    pub(super) columns: Option<usize>,
    /// Columns of the line whose beginning was sent.
    sent: usize,
}

impl Output {
    pub(super) fn new(line_end: &'static str, columns: Option<usize>) -> Self {
        Self { text: String::new(), line_end, columns, sent: 0 }
    }

    /// Writes `text`, and does not end the line.
    pub(super) fn put(&mut self, text: fmt::Arguments<'_>) {
        // Of what has no room the end is missing.
        let _ = self.text.write_fmt(text);
    }

    /// Writes `text` and ends the line, which takes several where the terminal is too narrow.
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

    /// The text was sent.
    pub(super) fn clear(&mut self) {
        self.sent = self.column();
        self.text.clear();
    }

    /// The columns of the line that has not ended.
    pub(super) fn column(&self) -> usize {
        match self.text.rsplit_once('\n') {
            Some((_, line)) => line.chars().count(),
            None => self.sent + self.text.chars().count(),
        }
    }

    /// Goes on in the next line.
    pub(super) fn indent(&mut self) {
        self.end();
        self.put(format_args!("{:INDENT$}", ""));
    }

    /// Whether there is room for `count` columns in the line.
    pub(super) fn has_room(&self, count: usize) -> bool {
        self.columns.is_none_or(|columns| self.column() + count <= columns)
    }

    /// Parts the line that has not ended at its blanks where the terminal is too narrow. It goes on at column `hang`, if there is
    /// room.
    pub(super) fn fold(&mut self, hang: usize) {
        let Some(columns) = self.columns.filter(|columns| self.column() > *columns) else { return };
        let hang = if hang + ROOM_MIN > columns { INDENT } else { hang };
        let (start, sent) = self.text.rfind('\n').map_or((0, self.sent), |at| (at + 1, 0));
        let line = self.text.clone();
        self.text.truncate(start);
        let mut column = sent;
        for word in line.get(start..).unwrap_or_default().split_inclusive(' ') {
            if column > hang && column + word.trim_end().chars().count() > columns {
                self.end();
                self.put(format_args!("{:hang$}", ""));
                column = hang;
            }
            self.put(format_args!("{word}"));
            column += word.chars().count();
        }
    }
}
