//! Waiting for a moment, where that is done for each transaction.
//!
//! A [`Timer`](embassy_time::Timer) leaves its time with the clock's driver and looks at it when it is polled again. Here a
//! moment that has passed is over at once, and where there is nothing to wait for the clock is not looked at.

use core::pin::Pin;
use core::task::{Context, Poll};

use embassy_time::{Duration, Instant};
use embassy_time_driver::schedule_wake;

/// Waits for the moment `at`; [`Instant::MAX`] never comes.
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

/// What `future` gives, unless it has to wait and that takes longer than `patience`.
pub(crate) fn within<F: Future + Unpin>(patience: Duration, future: F) -> Within<F> {
    Within { patience, future, end: None }
}

/// See [`within`].
#[must_use = "futures do nothing unless they are polled"]
pub(crate) struct Within<F> {
    patience: Duration,
    future: F,
    /// When patience ends, once there is something to wait for.
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

/// Polls `future` by code of its own, which does not become a part of whoever waits for it.
///
/// A future that contains many others is one large memory, and one function that finds everything in it by its distance from
/// the beginning. On a Cortex-M a part with much code is shorter, and takes fewer instructions, when it counts from its own
/// beginning.
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
