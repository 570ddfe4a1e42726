//! Timers for the transaction path.
//!
//! A [`Timer`](embassy_time::Timer) always registers with the clock's driver and checks the time when polled again. These
//! complete at once if the time has passed, and leave the clock alone if there is nothing to wait for.

use core::pin::Pin;
use core::task::{Context, Poll};

use embassy_time::{Duration, Instant};
use embassy_time_driver::schedule_wake;

/// Waits until `at`; [`Instant::MAX`] is never.
pub(crate) fn until(at: Instant) -> Until {
    Until(at)
}

/// See [`until`].
#[must_use = "futures do nothing unless they are polled"]
pub(crate) struct Until(Instant);

impl Future for Until {
    type Output = ();

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<()> {
        if self.0 == Instant::MAX {
            return Poll::Pending;
        }
        if self.0 <= Instant::now() {
            return Poll::Ready(());
        }
        schedule_wake(self.0.as_ticks(), context.waker());
        Poll::Pending
    }
}

/// The output of `future`, unless it is pending for longer than `patience`.
pub(crate) fn within<F: Future + Unpin>(patience: Duration, future: F) -> Within<F> {
    Within { patience, future, end: None }
}

/// See [`within`].
#[must_use = "futures do nothing unless they are polled"]
pub(crate) struct Within<F> {
    patience: Duration,
    future: F,
    /// The end of `patience`; set once `future` is pending.
    end: Option<Until>,
}

impl<F: Future + Unpin> Future for Within<F> {
    type Output = Option<F::Output>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<F::Output>> {
        if let Poll::Ready(output) = Pin::new(&mut self.future).poll(context) {
            return Poll::Ready(Some(output));
        }
        let patience = self.patience;
        let end = self.end.get_or_insert_with(|| until(Instant::now() + patience));
        Pin::new(end).poll(context).map(|()| None)
    }
}

/// Polls `future` in a function that is not inlined into the caller.
///
/// A future that contains many others is one large object, accessed by offsets from its start. On a Cortex-M, code that uses a
/// large part of it is shorter and faster with that part's own base address.
pub(crate) fn outlined<F: Future>(future: Pin<&mut F>) -> Outlined<'_, F> {
    Outlined(future)
}

/// See [`outlined`].
#[must_use = "futures do nothing unless they are polled"]
pub(crate) struct Outlined<'f, F>(Pin<&'f mut F>);

impl<F: Future> Future for Outlined<'_, F> {
    type Output = F::Output;

    #[inline(never)]
    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<F::Output> {
        self.0.as_mut().poll(context)
    }
}
