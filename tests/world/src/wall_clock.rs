//! The wall clock, in one thread: a future that runs beside file descriptors.

use std::future::Future;
use std::io;
use std::os::fd::BorrowedFd;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Wake, Waker};

use embassy_time::Instant;
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::time::TimeSpec;
use nix::time::{ClockId, clock_gettime};

struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Runs `future` until it is done. Between its polls `look` takes what has come at `sources`, piece by piece: it says whether there
/// was anything.
///
/// # Errors
/// What `look` says, or the system.
pub fn run_beside<T>(
    sources: &[BorrowedFd<'_>],
    mut look: impl FnMut() -> io::Result<bool>,
    future: impl Future<Output = T>,
) -> io::Result<T> {
    let mut future = pin!(future);
    let woken = Arc::new(Woken(AtomicBool::new(true)));
    let waker = Waker::from(woken.clone());
    loop {
        mobgate_clock::fire_due();
        while woken.0.swap(false, Ordering::Relaxed) {
            if let Poll::Ready(value) = future.as_mut().poll(&mut Context::from_waker(&waker)) {
                return Ok(value);
            }
        }
        if !look()? {
            wait(sources, mobgate_clock::next_alarm().map(Instant::from_ticks))?;
        }
    }
}

/// Milliseconds of the host's own clock, which other programs have too.
pub fn host_milliseconds() -> u64 {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC).unwrap();
    now.tv_sec() as u64 * 1_000 + now.tv_nsec() as u64 / 1_000_000
}

/// Waits until something comes at one of `sources`, or until that time.
///
/// # Errors
/// What the system says.
pub fn wait(sources: &[BorrowedFd<'_>], until: Option<Instant>) -> io::Result<()> {
    let timeout = until.map(|until| {
        let left = until.saturating_duration_since(Instant::now());
        TimeSpec::from(std::time::Duration::from_micros(left.as_micros()))
    });
    let mut polled: Vec<_> = sources.iter().map(|&source| PollFd::new(source, PollFlags::POLLIN)).collect();
    match ppoll(&mut polled, timeout, None) {
        Ok(_) | Err(nix::errno::Errno::EINTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}
