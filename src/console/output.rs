//! Lines of output to a stream, each formatted into a buffer of fixed size first.

use core::fmt::{self, Write as _};

use embedded_io_async::{Read, Write};
use heapless::String;

use crate::config::LINE_BYTES_MAX;

/// Longest line of output: a line of settings, or a rule's row in a table, and some more.
const OUTPUT_BYTES_MAX: usize = LINE_BYTES_MAX + 128;

/// The stream of a console.
pub(super) struct Output<IO> {
    stream: IO,
    line: String<OUTPUT_BYTES_MAX>,
    line_end: &'static str,
}

impl<IO: Read + Write> Output<IO> {
    pub(super) fn new(stream: IO, line_end: &'static str) -> Self {
        Self { stream, line: String::new(), line_end }
    }

    /// Writes `text` and ends the line.
    pub(super) async fn line(&mut self, text: fmt::Arguments<'_>) -> Result<(), IO::Error> {
        // No line is longer than the buffer; if one were, its end would be missing.
        let _ = self.begin().write_fmt(text);
        self.end().await
    }

    /// Where the next line is put together.
    pub(super) fn begin(&mut self) -> &mut String<OUTPUT_BYTES_MAX> {
        self.line.clear();
        &mut self.line
    }

    /// Writes that line and ends it.
    pub(super) async fn end(&mut self) -> Result<(), IO::Error> {
        let text = self.line.trim_end();
        self.stream.write_all(text.as_bytes()).await?;
        self.stream.write_all(self.line_end.as_bytes()).await
    }

    /// Writes `text`, and does not end the line.
    pub(super) async fn text_only(&mut self, text: fmt::Arguments<'_>) -> Result<(), IO::Error> {
        // See `line`.
        let _ = self.begin().write_fmt(text);
        self.stream.write_all(self.line.as_bytes()).await
    }

    /// Writes `text` as it is.
    pub(super) async fn text(&mut self, text: &str) -> Result<(), IO::Error> {
        self.stream.write_all(text.as_bytes()).await
    }

    pub(super) async fn flush(&mut self) -> Result<(), IO::Error> {
        self.stream.flush().await
    }

    pub(super) async fn read(&mut self, into: &mut [u8]) -> Result<usize, IO::Error> {
        self.stream.read(into).await
    }
}
