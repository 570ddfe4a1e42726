//! A board's stream and clock as picoserve wants them.

use core::cell::Cell;
use core::future::pending;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::Instant;
use embedded_io_async::{Error, ErrorKind, ErrorType, Read, Write};
use picoserve::io::{Socket, Write as LendingWrite};
use picoserve::mem::{BorrowedBuffer, BorrowedCursor};
use picoserve::time::Duration;
use picoserve::{Timeouts, Timer};

use crate::hal::TcpStream;

/// Bytes of a request: its head, and its body. A browser's head takes 1 KiB at most.
pub(super) const REQUEST_BYTES_MAX: usize = if cfg!(feature = "long-requests") { 16 * 1_024 } else { 2_560 };
/// Bytes read from a connection; data beyond the largest request is not read, and its sender still gets a response.
const READ_BYTES_MAX: usize = 2 * REQUEST_BYTES_MAX;
/// Bytes of a response's head written at a time.
const PIECE_BYTES: usize = 160;

/// The executor.
pub(super) struct Embassy;

/// Lifetime of a connection and limits of its data; a call may extend them.
pub(super) struct Life {
    end: Cell<Instant>,
    /// Bytes that may still be read.
    left: Cell<usize>,
    /// Its request may take as long as the connection lives.
    takes_upload: Cell<bool>,
    /// The gateway restarts after it.
    pub(super) restarts: Cell<bool>,
}

impl Life {
    pub(super) fn new(age: embassy_time::Duration) -> Self {
        Self {
            end: Cell::new(Instant::now() + age),
            left: Cell::new(READ_BYTES_MAX),
            takes_upload: Cell::new(false),
            restarts: Cell::new(false),
        }
    }

    /// Waits until its end, which may be moved meanwhile.
    pub(super) async fn is_over(&self) {
        while Instant::now() < self.end.get() {
            embassy_time::Timer::at(self.end.get()).await;
        }
    }

    /// It ends after this time.
    pub(super) fn lasts(&self, time: embassy_time::Duration) {
        self.end.set(Instant::now() + time);
    }

    /// A body of this many bytes follows; its reader enforces the time limit.
    pub(super) fn takes_upload(&self, bytes: usize) {
        self.left.set(self.left.get().saturating_add(bytes));
        self.takes_upload.set(true);
    }
}

/// The clock of a connection.
pub(super) struct Clock<'l>(pub(super) &'l Life);

impl Timer<Embassy> for Clock<'_> {
    async fn delay(&self, duration: Duration) {
        embassy_time::Timer::after_millis(duration.as_millis()).await;
        if self.0.takes_upload.get() {
            // The connection ends instead.
            pending().await
        }
    }
}

/// The connection has failed.
#[derive(Debug, thiserror::Error)]
#[error("the connection is lost")]
pub(super) struct Lost;

impl Error for Lost {
    fn kind(&self) -> ErrorKind {
        ErrorKind::ConnectionReset
    }
}

/// A stream in two halves, which are not used at once: a request is read before its response is written.
pub(super) struct Halves<'s, T> {
    stream: Mutex<NoopRawMutex, &'s mut T>,
    life: &'s Life,
}

impl<'s, T> Halves<'s, T> {
    pub(super) fn new(stream: &'s mut T, life: &'s Life) -> Self {
        Self { stream: Mutex::new(stream), life }
    }
}

/// One of them.
pub(super) struct Half<'h, 's, T>(&'h Halves<'s, T>);

impl<T> ErrorType for Half<'_, '_, T> {
    type Error = Lost;
}

impl<T: TcpStream> Read for Half<'_, '_, T> {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Lost> {
        let most = into.len().min(self.0.life.left.get());
        let Some(into) = into.get_mut(..most).filter(|into| !into.is_empty()) else { return Ok(0) };
        let count = self.0.stream.lock().await.read(into).await.map_err(|_| Lost)?;
        self.0.life.left.set(self.0.life.left.get().saturating_sub(count));
        Ok(count)
    }
}

impl<T: TcpStream> Write for Half<'_, '_, T> {
    async fn write(&mut self, from: &[u8]) -> Result<usize, Lost> {
        self.0.stream.lock().await.write(from).await.map_err(|_| Lost)
    }

    async fn flush(&mut self) -> Result<(), Lost> {
        Ok(())
    }
}

impl<T: TcpStream> LendingWrite for Half<'_, '_, T> {
    async fn write_with<F: FnOnce(BorrowedCursor<'_>) -> R, R>(&mut self, f: F) -> Result<R, Lost> {
        let mut piece = [0; PIECE_BYTES];
        let mut piece = BorrowedBuffer::new(&mut piece);
        let result = f(piece.unfilled());
        self.write_all(piece.filled()).await?;
        Ok(result)
    }
}

impl<'s, T: TcpStream> Socket<Embassy> for Halves<'s, T> {
    type Error = Lost;
    type ReadHalf<'a>
        = Half<'a, 's, T>
    where
        Self: 'a;
    type WriteHalf<'a>
        = Half<'a, 's, T>
    where
        Self: 'a;

    fn split(&mut self) -> (Half<'_, 's, T>, Half<'_, 's, T>) {
        (Half(self), Half(self))
    }

    /// The stream's owner closes it.
    async fn abort<C: Timer<Embassy>>(self, _: &Timeouts, _: &C) -> Result<(), picoserve::Error<Lost>> {
        Ok(())
    }

    /// The stream's owner closes it.
    async fn shutdown<C: Timer<Embassy>>(self, _: &Timeouts, _: &C) -> Result<(), picoserve::Error<Lost>> {
        Ok(())
    }
}
