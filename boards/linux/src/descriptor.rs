//! A non-blocking descriptor for one reading and writing task.
//!
//! Bytes are read and written by system calls of rustix: those of libc are cancellation points, which takes some 50 instructions of
//! each call in a program that has threads.

use std::future::poll_fn;
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::task::{Context, Poll, ready};

use embassy_time::{Duration, Instant, Timer};
use rustix::io::ioctl_fionbio;

use crate::reactor::{Direction, Registration};

/// Most operations in a row before other tasks run. Embassy's tasks are cooperative, and an operation on a ready descriptor never
/// suspends, so a babbling line would block all others.
const TURNS_MAX: u8 = 32;

/// Muting and unmuting costs two system calls, about as much as two wake-ups.
const REST_MIN: Duration = Duration::from_micros(100);

/// An open descriptor, registered for reading and writing.
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

    /// Calls `read` until it does not block. A dropped future has read nothing.
    pub(crate) fn read_with<R>(
        &mut self,
        mut read: impl FnMut(&T) -> io::Result<R>,
    ) -> impl Future<Output = io::Result<R>> {
        poll_fn(move |context| self.poll_read(context, &mut read))
    }

    /// Waits until something has arrived since the last call, read or not.
    pub(crate) fn arrival(&self) -> impl Future<Output = ()> {
        let reading = self.registration.reading();
        poll_fn(move |context| reading.poll_ready(context).map(|()| reading.block()))
    }

    /// Reads from a stream socket or a tty into `buffer`. A short read means that the input is drained (epoll(7)), so the next read
    /// waits for an event and saves the EAGAIN.
    pub(crate) fn read_stream(&mut self, buffer: &mut [u8]) -> impl Future<Output = io::Result<usize>> {
        poll_fn(move |context| {
            let count =
                ready!(self.poll_read(context, &mut |io: &T| Ok(rustix::io::read(io, &mut *buffer)?)))?;
            if count < buffer.len() {
                self.registration.reading().block_unless_over();
                self.registration.unmute(&self.io)?;
            }
            Poll::Ready(Ok(count))
        })
    }

    /// Sleeps until `until` without wake-ups by arriving data, if the time is long enough; returns whether it slept.
    pub(crate) async fn rest(&mut self, until: Instant) -> bool {
        let sleeps = until >= Instant::now() + REST_MIN && self.registration.mute(&self.io).is_ok();
        if sleeps {
            Timer::at(until).await;
        }
        sleeps
    }

    /// Writes to a stream socket or a tty.
    pub(crate) fn write_stream(&mut self, from: &[u8]) -> impl Future<Output = io::Result<usize>> {
        self.write_with(|io| Ok(rustix::io::write(io, from)?))
    }

    /// Calls `write` until it does not block. A dropped future has written nothing.
    pub(crate) async fn write_with<R>(
        &mut self,
        mut write: impl FnMut(&T) -> io::Result<R>,
    ) -> io::Result<R> {
        let mut watched = false;
        let written = poll_fn(|context| {
            self.operate(context, Registration::writing, &mut write, |registration, io| {
                watched = true;
                registration.watch_writing(io, true)
            })
        })
        .await;
        if watched {
            self.registration.watch_writing(&self.io, false)?;
        }
        written
    }

    fn poll_read<R>(
        &mut self,
        context: &Context<'_>,
        read: &mut impl FnMut(&T) -> io::Result<R>,
    ) -> Poll<io::Result<R>> {
        self.operate(context, Registration::reading, read, |registration, io| registration.unmute(io))
    }

    /// Calls `operation` whenever its direction is ready, until it does not block; calls `blocked` each time it does.
    fn operate<R>(
        &mut self,
        context: &Context<'_>,
        direction: impl Fn(&Registration) -> &Direction,
        operation: &mut impl FnMut(&T) -> io::Result<R>,
        mut blocked: impl FnMut(&Registration, &T) -> io::Result<()>,
    ) -> Poll<io::Result<R>> {
        let Self { io, registration, turns } = self;
        loop {
            if direction(registration).poll_ready(context).is_pending() {
                *turns = 0;
                return Poll::Pending;
            }
            // Before the operation: a dropped future must not lose a result.
            *turns += 1;
            if *turns >= TURNS_MAX {
                *turns = 0;
                context.waker().wake_by_ref();
                return Poll::Pending;
            }
            match operation(io) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    direction(registration).block();
                    blocked(registration, io)?;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                done => return Poll::Ready(done),
            }
        }
    }
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
