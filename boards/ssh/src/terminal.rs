//! Connects a channel and its console: buffers the bytes typed, and those to be shown.

use core::cell::Cell;
use core::convert::Infallible;

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use embedded_io_async::{ErrorType, Read, Write};

/// Bytes that a client may send ahead.
pub(crate) const WINDOW_BYTES: usize = 1024;
/// Room for reports of the terminal's size, besides.
const REPORTS_BYTES: usize = 64;
/// Bytes that wait to be sent.
pub(crate) const SHOWN_BYTES: usize = 512;

/// Both directions.
pub(crate) struct Terminal {
    typed: Pipe<NoopRawMutex, { WINDOW_BYTES + REPORTS_BYTES }>,
    shown: Pipe<NoopRawMutex, SHOWN_BYTES>,
    /// Nothing more is typed.
    has_ended: Cell<bool>,
    end: Signal<NoopRawMutex, ()>,
    /// The console has read something.
    was_read: Signal<NoopRawMutex, ()>,
    /// Each line end that is shown is one of a raw terminal.
    is_raw: Cell<bool>,
}

impl Terminal {
    pub(crate) const fn new() -> Self {
        Self {
            typed: Pipe::new(),
            shown: Pipe::new(),
            has_ended: Cell::new(false),
            end: Signal::new(),
            was_read: Signal::new(),
            is_raw: Cell::new(false),
        }
    }

    /// Passes on what was typed, all of it or nothing; returns whether there was room.
    pub(crate) fn type_in(&self, bytes: &[u8]) -> bool {
        let fits = bytes.len() <= self.typed.free_capacity();
        let mut rest = bytes;
        while fits && let Ok(count @ 1..) = self.typed.try_write(rest) {
            rest = rest.get(count..).unwrap_or_default();
        }
        fits
    }

    /// Nothing more is typed.
    pub(crate) fn end(&self) {
        self.has_ended.set(true);
        self.end.signal(());
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.has_ended.get()
    }

    /// What is shown are lines, which a raw terminal takes with another end.
    pub(crate) fn make_raw(&self) {
        self.is_raw.set(true);
    }

    /// Bytes that the console has not read.
    pub(crate) fn unread(&self) -> usize {
        self.typed.len()
    }

    /// Waits until the console reads something.
    pub(crate) async fn was_read(&self) {
        self.was_read.wait().await;
    }

    /// Waits for something to show. Dropping the pending future loses nothing.
    pub(crate) async fn shown(&self, into: &mut [u8]) -> usize {
        self.shown.read(into).await
    }

    pub(crate) fn has_shown_all(&self) -> bool {
        self.shown.is_empty()
    }
}

impl ErrorType for &Terminal {
    type Error = Infallible;
}

impl Read for &Terminal {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        loop {
            if let Ok(count) = self.typed.try_read(into) {
                self.was_read.signal(());
                return Ok(count);
            }
            if self.has_ended.get() {
                return Ok(0);
            }
            if let Either::First(count) = select(self.typed.read(into), self.end.wait()).await {
                self.was_read.signal(());
                return Ok(count);
            }
        }
    }
}

impl Write for &Terminal {
    async fn write(&mut self, from: &[u8]) -> Result<usize, Infallible> {
        if !self.is_raw.get() {
            return Ok(self.shown.write(from).await);
        }
        let line = from.split(|byte| *byte == b'\n').next().unwrap_or_default();
        if !line.is_empty() {
            return Ok(self.shown.write(line).await);
        }
        self.shown.write_all(from.get(..1).map_or(&[][..], |_| b"\r\n")).await;
        Ok(from.len().min(1))
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
