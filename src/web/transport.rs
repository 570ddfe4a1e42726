//! A board's stream and clock as picoserve wants them.

use core::cell::Cell;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_io_async::{Error, ErrorKind, ErrorType, Read, Write};
use picoserve::io::{Socket, Write as LendingWrite};
use picoserve::mem::{BorrowedBuffer, BorrowedCursor};
use picoserve::time::Duration;
use picoserve::{Timeouts, Timer};

use crate::hal::TcpStream;

/// Bytes of a request: its head, and its body. A browser's head takes 1 KiB at most.
pub(super) const REQUEST_BYTES_MAX: usize = if cfg!(feature = "long-requests") { 16 * 1_024 } else { 2_560 };
/// Bytes read of a connection: what comes behind a request of the largest size is not read, and its sender gets an answer.
const READ_BYTES_MAX: usize = 2 * REQUEST_BYTES_MAX;
/// Bytes of a response's head written at a time.
const PIECE_BYTES: usize = 256;

/// The executor.
pub(super) struct Embassy;

/// The clock.
pub(super) struct Clock;

impl Timer<Embassy> for Clock {
    fn delay(&self, duration: Duration) -> impl Future<Output = ()> {
        embassy_time::Timer::after_millis(duration.as_millis())
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
    /// Bytes that may still be read.
    left: Cell<usize>,
}

impl<'s, T> Halves<'s, T> {
    pub(super) fn new(stream: &'s mut T) -> Self {
        Self { stream: Mutex::new(stream), left: Cell::new(READ_BYTES_MAX) }
    }
}

/// One of them.
pub(super) struct Half<'h, 's, T>(&'h Halves<'s, T>);

impl<T> ErrorType for Half<'_, '_, T> {
    type Error = Lost;
}

impl<T: TcpStream> Read for Half<'_, '_, T> {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Lost> {
        let most = into.len().min(self.0.left.get());
        let Some(into) = into.get_mut(..most).filter(|into| !into.is_empty()) else { return Ok(0) };
        let count = self.0.stream.lock().await.read(into).await.map_err(|_| Lost)?;
        self.0.left.set(self.0.left.get().saturating_sub(count));
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

    /// Whoever has the stream closes it.
    async fn abort<C: Timer<Embassy>>(self, _: &Timeouts, _: &C) -> Result<(), picoserve::Error<Lost>> {
        Ok(())
    }

    /// As above.
    async fn shutdown<C: Timer<Embassy>>(self, _: &Timeouts, _: &C) -> Result<(), picoserve::Error<Lost>> {
        Ok(())
    }
}
