//! A non-blocking descriptor that one task reads and writes.
//!
//! async-io's own futures register with epoll each time they are made, and try the operation each time they are polled.
//! The core makes a new `read` future whenever something else happened to its port, so here the registration
//! outlives the future: a transaction costs a third of the system calls.

use std::future::poll_fn;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::task::{Context, Poll, ready};

use async_io::Async;
use futures_lite::future::yield_now;

/// Operations that may succeed at once, one after the other. Embassy's tasks are cooperative, and an operation on a
/// ready descriptor never suspends, so that a babbling line would stop every other one.
const TURNS_MAX: u8 = 32;

/// An open descriptor with its reader and its writer.
#[derive(Debug)]
pub(crate) struct Descriptor<T> {
    io: Async<T>,
    turns: u8,
    read_blocked: bool,
    write_blocked: bool,
}

impl<T: AsFd> Descriptor<T> {
    pub(crate) fn new(io: Async<T>) -> Self {
        Self { io, turns: 0, read_blocked: false, write_blocked: false }
    }

    pub(crate) fn get_ref(&self) -> &T {
        self.io.get_ref()
    }

    /// Calls `read` until it does not have to wait. A dropped future has read nothing.
    pub(crate) async fn read_with<R>(&mut self, read: impl FnMut(&T) -> io::Result<R>) -> io::Result<R> {
        self.take_turn().await;
        let Self { io, read_blocked, .. } = self;
        operate(io, read_blocked, read, Async::poll_readable).await
    }

    /// Calls `write` until it does not have to wait. A dropped future has written nothing.
    pub(crate) async fn write_with<R>(&mut self, write: impl FnMut(&T) -> io::Result<R>) -> io::Result<R> {
        self.take_turn().await;
        let Self { io, write_blocked, .. } = self;
        operate(io, write_blocked, write, Async::poll_writable).await
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

/// Calls `operation` when `poll_ready` says so; `blocked` remembers over futures that it has been asked to.
async fn operate<T, R>(
    io: &Async<T>,
    blocked: &mut bool,
    mut operation: impl FnMut(&T) -> io::Result<R>,
    poll_ready: impl Fn(&Async<T>, &mut Context<'_>) -> Poll<io::Result<()>>,
) -> io::Result<R> {
    poll_fn(|context| {
        loop {
            if *blocked {
                ready!(poll_ready(io, context))?;
                *blocked = false;
            }
            match operation(io.get_ref()) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => *blocked = true,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                done => return Poll::Ready(done),
            }
        }
    })
    .await
}

impl<T: AsFd> AsFd for Descriptor<T> {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.io.get_ref().as_fd()
    }
}
