//! Checks that every task still makes progress; the watchdog is fed only then.
//!
//! An idle task may wait for days, so each task is woken now and then, and being polled counts as its response. A task that does not
//! respond is stuck behind one that never returns, has ended, or was never started. Drop or finish a task's `watch` only when the
//! task has ended.

use core::future::{Future, poll_fn};
use core::pin::Pin;
use core::sync::atomic::{AtomicBool, Ordering};

use embassy_sync::waitqueue::AtomicWaker;

/// The `N` tasks of a board.
pub struct Liveness<const N: usize>([Watched; N]);

struct Watched {
    waker: AtomicWaker,
    answered: AtomicBool,
}

impl<const N: usize> Liveness<N> {
    /// No task has answered yet.
    pub const fn new() -> Self {
        Self([const { Watched { waker: AtomicWaker::new(), answered: AtomicBool::new(false) } }; N])
    }

    /// Runs `future` as task number `task`. An unknown number is not monitored.
    ///
    /// The caller pins the future: moving it in would take its memory twice.
    pub fn watch<F: Future>(&self, task: usize, mut future: Pin<&mut F>) -> impl Future<Output = F::Output> {
        let watched = self.0.get(task);
        let mut is_registered = false;
        poll_fn(move |context| {
            // A task has one waker for all its life.
            if let Some(watched) = watched.filter(|_| !is_registered) {
                watched.waker.register(context.waker());
                is_registered = true;
            }
            let output = future.as_mut().poll(context);
            if let Some(watched) = watched {
                // After the poll: a poll that never returns is no response, nor is the last one of a task that ends.
                watched.answered.store(output.is_pending(), Ordering::Relaxed);
            }
            output
        })
    }

    /// Wakes every task; the responses are complete once each has been polled.
    pub fn ask(&self) {
        for watched in &self.0 {
            watched.answered.store(false, Ordering::Relaxed);
            watched.waker.wake();
        }
    }

    /// The first task that has not answered since the last [`ask`](Self::ask).
    pub fn silent(&self) -> Option<usize> {
        self.0.iter().position(|watched| !watched.answered.load(Ordering::Relaxed))
    }
}

#[cfg(test)]
mod tests {
    use core::future::{Future, pending, ready};
    use core::pin::pin;
    use core::task::{Context, Waker};

    use super::Liveness;

    fn poll(future: core::pin::Pin<&mut impl Future>) {
        let _ = future.poll(&mut Context::from_waker(Waker::noop()));
    }

    #[test]
    fn tasks_that_only_wait_respond_each_time_they_are_polled() {
        let tasks = Liveness::<2>::new();
        let (first, second) = (pin!(pending::<()>()), pin!(pending::<()>()));
        let (mut one, mut two) = (pin!(tasks.watch(0, first)), pin!(tasks.watch(1, second)));
        for _ in 0..3 {
            tasks.ask();
            poll(one.as_mut());
            assert_eq!(tasks.silent(), Some(1));
            poll(two.as_mut());
            assert_eq!(tasks.silent(), None);
        }
    }

    #[test]
    fn a_task_that_was_never_started_or_has_ended_is_missed() {
        let tasks = Liveness::<2>::new();
        let (first, second) = (pin!(pending::<()>()), pin!(ready(())));
        let mut one = pin!(tasks.watch(0, first));
        poll(one.as_mut());
        assert_eq!(tasks.silent(), Some(1), "never started");
        let mut two = pin!(tasks.watch(1, second));
        poll(two.as_mut());
        assert_eq!(tasks.silent(), Some(1), "ended");
    }

    #[test]
    fn a_sleeping_task_is_woken_by_the_question() {
        use embassy_futures::block_on;
        use embassy_futures::select::select;
        let tasks = Liveness::<1>::new();
        let asked = async {
            tasks.ask();
            // Lets the other one run, because it was woken.
            embassy_futures::yield_now().await;
            assert_eq!(tasks.silent(), None);
        };
        block_on(select(tasks.watch(0, pin!(pending::<()>())), asked));
    }
}
