//! Embassy's executor in one Linux thread, which sleeps in the [`reactor`].
//!
//! The path of a wake-up: epoll reports a readable descriptor, the reactor wakes the task that waits for it, the task enters
//! embassy's run queue, the queue calls `__pender`, and the pender wakes the future that [`run`] blocks on. That future polls the
//! run queue until it is empty.

use std::future::{Future, poll_fn};
use std::num::NonZeroU64;
use std::pin::pin;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::task::Waker;

use embassy_executor::{Spawner, raw};
use rustix::thread::set_current_timer_slack;

use crate::reactor;

/// Most passes over the run queue before polling for I/O again: tasks that keep waking each other must not starve the sockets.
const ROUNDS_MAX: usize = 32;

/// Runs the tasks that `init` spawns, and those that they spawn, until `end` is ready. Unfinished tasks are not dropped: the
/// process is about to end.
pub fn run<T>(init: impl FnOnce(Spawner), end: impl Future<Output = T>) -> T {
    let pended: &'static Pended = Box::leak(Box::new(Pended::new()));
    let context = std::ptr::from_ref(pended).cast_mut().cast::<()>();
    let executor: &'static raw::Executor = Box::leak(Box::new(raw::Executor::new(context)));
    init(executor.spawner());

    // This thread times the silences between frames, and the kernel's default slack may delay a wake-up by 50 us. A system without
    // it may refuse.
    let _ = set_current_timer_slack(Some(NonZeroU64::MIN));
    let mut end = pin!(end);
    reactor::block_on(poll_fn(|context| {
        pended.waker.get_or_init(|| context.waker().clone());
        pended.polling.store(true, SeqCst);
        for _ in 0..ROUNDS_MAX {
            pended.work.store(false, SeqCst);
            // One outer critical section makes the nested ones of the tasks cheap. Other threads only wake tasks, and no task waits
            // for them without suspending.
            // SAFETY: `poll` must not run concurrently, and only in the thread that made the executor. Only this closure has the
            // executor, and `block_on` calls it in this thread, never from a task.
            critical_section::with(|_| unsafe { executor.poll() });
            if !pended.work.load(SeqCst) {
                break;
            }
        }
        pended.polling.store(false, SeqCst);
        if pended.work.load(SeqCst) {
            context.waker().wake_by_ref();
        }
        end.as_mut().poll(context)
    }))
}

/// Tells [`run`] that the run queue has work.
struct Pended {
    work: AtomicBool,
    /// `run` is polling the queue and will see `work`: waking it would cost a pass through the reactor.
    polling: AtomicBool,
    /// Wakes `run`; set in its first round.
    waker: OnceLock<Waker>,
}

impl Pended {
    const fn new() -> Self {
        Self { work: AtomicBool::new(false), polling: AtomicBool::new(false), waker: OnceLock::new() }
    }
}

/// Called by the executor, from any thread, when its run queue becomes non-empty.
#[unsafe(export_name = "__pender")]
fn pender(context: *mut ()) {
    // SAFETY: `run` creates every executor of this program, with a leaked `Pended` as its context.
    let pended: &'static Pended = unsafe { &*context.cast::<Pended>() };
    pended.work.store(true, SeqCst);
    if !pended.polling.load(SeqCst)
        && let Some(waker) = pended.waker.get()
    {
        waker.wake_by_ref();
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::rc::Rc;
    use std::time::{Duration, Instant};

    use super::run;

    #[embassy_executor::task]
    async fn count(turns: Rc<Cell<u32>>) {
        for _ in 0..100 {
            embassy_time::Timer::after_micros(200).await;
            turns.set(turns.get() + 1);
        }
    }

    #[embassy_executor::task]
    async fn hog() {
        loop {
            embassy_futures::yield_now().await;
        }
    }

    #[test]
    fn embassy_timers_fire_inside_of_the_reactor() {
        let turns = Rc::new(Cell::new(0));
        let start = Instant::now();
        let seen = run(|spawner| spawner.spawn(count(turns.clone()).unwrap()), async {
            while turns.get() < 100 {
                embassy_time::Timer::after_millis(1).await;
            }
            turns.get()
        });
        assert_eq!(seen, 100);
        assert!(start.elapsed() >= Duration::from_millis(20));
    }

    #[test]
    fn a_task_that_never_rests_keeps_no_io_from_being_seen() {
        run(|spawner| spawner.spawn(hog().unwrap()), async { embassy_time::Timer::after_millis(5).await });
    }

    #[test]
    fn a_wake_from_another_thread_reaches_a_task() {
        #[embassy_executor::task]
        async fn respond(into: Rc<Cell<u32>>) {
            let there = crate::worker::once(|| {
                std::thread::sleep(Duration::from_millis(5)); // the executor is asleep by then
                7
            });
            into.set(there.await.unwrap());
        }
        let into = Rc::new(Cell::new(0));
        run(|spawner| spawner.spawn(respond(into.clone()).unwrap()), async {
            while into.get() == 0 {
                embassy_time::Timer::after_millis(1).await;
            }
        });
        assert_eq!(into.get(), 7);
    }
}
