//! Threads for blocking work: opening a device, a slow disk, a stopped terminal.
//!
//! A worker's thread sleeps until there is work, without a time-out, and ends with its [`Worker`]: an idle worker never wakes up.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, mpsc};
use std::thread;

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;

type Work = Box<dyn FnOnce() + Send>;

/// A thread that runs jobs in order.
#[derive(Debug)]
pub(crate) struct Worker(mpsc::Sender<Work>);

impl Worker {
    /// Starts the thread.
    pub(crate) fn start() -> io::Result<Self> {
        let (sender, works) = mpsc::channel::<Work>();
        thread::Builder::new().name("worker".into()).spawn(move || works.iter().for_each(|work| work()))?;
        Ok(Self(sender))
    }

    /// Runs `work` and returns its result. The work is completed even if this future is dropped.
    pub(crate) async fn run<T: Send + 'static>(&self, work: impl FnOnce() -> T + Send + 'static) -> T {
        let done = Arc::new(Signal::<CriticalSectionRawMutex, thread::Result<T>>::new());
        let told = done.clone();
        let work = Box::new(move || told.signal(catch_unwind(AssertUnwindSafe(work))));
        // The thread ends only with the sender, since panics are caught.
        self.0.send(work).expect("the thread is there");
        done.wait().await.unwrap_or_else(|panic| resume_unwind(panic))
    }
}

/// Runs `work` in a separate thread and returns its result.
pub(crate) async fn once<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> io::Result<T> {
    Ok(Worker::start()?.run(work).await)
}

#[cfg(test)]
mod tests {
    use super::{Worker, once};
    use crate::reactor::block_on;

    #[test]
    fn work_is_done_in_order_and_gives_its_result() {
        let worker = Worker::start().unwrap();
        let (sender, order) = std::sync::mpsc::channel();
        for number in 0..3 {
            let sender = sender.clone();
            assert_eq!(block_on(worker.run(move || sender.send(number).map(|()| number))), Ok(number));
        }
        assert_eq!(order.try_iter().collect::<Vec<_>>(), [0, 1, 2]);
    }

    #[test]
    #[should_panic(expected = "the disk is gone")]
    fn a_panic_comes_to_whoever_waits() {
        let _ = block_on(once(|| panic!("the disk is gone")));
    }
}
