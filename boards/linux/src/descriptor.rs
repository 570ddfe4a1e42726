//! A non-blocking descriptor that one task reads and writes.

use std::future::poll_fn;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::task::{Poll, ready};

use embassy_time::{Duration, Instant, Timer};
use futures_lite::future::yield_now;
use rustix::io::ioctl_fionbio;

use crate::reactor::{Direction, Registration};

/// Operations that may succeed at once, one after the other. Embassy's tasks are cooperative, and an operation on a
/// ready descriptor never suspends, so that a babbling line would stop every other one.
const TURNS_MAX: u8 = 32;

/// To be left alone and watched again costs two system calls, about as much as to be woken twice.
const REST_MIN: Duration = Duration::from_micros(100);

/// An open descriptor with its reader and its writer.
#[derive(Debug)]
pub(crate) struct Descriptor<T: AsFd> {
    io: T,
    registration: Registration,
    turns: u8,
}

impl<T: AsFd> Descriptor<T> {
    /// Makes `io` non-blocking and registers it with the thread's reactor.
    pub(crate) fn new(io: T) -> io::Result<Self> {
        ioctl_fionbio(&io, true)?;
        let registration = Registration::new(&io)?;
        Ok(Self { io, registration, turns: 0 })
    }

    pub(crate) fn get_ref(&self) -> &T {
        &self.io
    }

    /// Calls `read` until it does not have to wait. A dropped future has read nothing.
    pub(crate) async fn read_with<R>(&mut self, read: impl FnMut(&T) -> io::Result<R>) -> io::Result<R> {
        self.take_turn().await;
        let Self { io, registration, .. } = self;
        operate(io, registration.reading(), read, || registration.unmute(&*io)).await
    }

    /// Sleeps until `until` without being woken by what comes meanwhile, if that is worth it.
    pub(crate) async fn rest(&mut self, until: Instant) -> bool {
        let sleeps = until >= Instant::now() + REST_MIN && self.registration.mute(&self.io).is_ok();
        if sleeps {
            Timer::at(until).await;
        }
        sleeps
    }

    /// Calls `write` until it does not have to wait. A dropped future has written nothing.
    pub(crate) async fn write_with<R>(&mut self, write: impl FnMut(&T) -> io::Result<R>) -> io::Result<R> {
        self.take_turn().await;
        let Self { io, registration, .. } = self;
        let mut watched = false;
        let watch = || {
            watched = true;
            registration.watch_writing(&*io, true)
        };
        let written = operate(io, registration.writing(), write, watch).await;
        if watched {
            registration.watch_writing(&*io, false)?;
        }
        written
    }

    /// Reads from a stream socket into `buffer`. Fewer bytes than asked for mean that there are no more for now
    /// (epoll(7)), so the next read waits for an event instead of being refused by the kernel.
    pub(crate) async fn read_stream(
        &mut self,
        buffer: &mut [u8],
        mut read: impl FnMut(&T, &mut [u8]) -> io::Result<usize>,
    ) -> io::Result<usize> {
        let length = buffer.len();
        let count = self.read_with(|io| read(io, buffer)).await?;
        if count < length {
            self.registration.reading().block_unless_over();
        }
        Ok(count)
    }

    /// Lets other tasks run now and then; before an operation, because a dropped future must not lose a result.
    async fn take_turn(&mut self) {
        self.turns += 1;
        if self.turns >= TURNS_MAX {
            self.turns = 0;
            yield_now().await;
        }
    }
}

/// Calls `operation` whenever `direction` is ready, until it does not have to wait; `blocked` each time that it would.
async fn operate<T, R>(
    io: &T,
    direction: &Direction,
    mut operation: impl FnMut(&T) -> io::Result<R>,
    mut blocked: impl FnMut() -> io::Result<()>,
) -> io::Result<R> {
    poll_fn(|context| {
        loop {
            ready!(direction.poll_ready(context));
            match operation(io) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    direction.block();
                    blocked()?;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                done => return Poll::Ready(done),
            }
        }
    })
    .await
}

impl<T: AsFd> AsFd for Descriptor<T> {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.io.as_fd()
    }
}

impl<T: AsFd> Drop for Descriptor<T> {
    fn drop(&mut self) {
        self.registration.remove(&self.io);
    }
}
