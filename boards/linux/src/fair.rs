//! A share of the executor: a descriptor that always has something to read must let other tasks run.

use futures_lite::future::yield_now;

/// Operations that may succeed at once, one after the other.
const TURNS_MAX: u8 = 32;

/// Counts operations and yields now and then. Embassy's tasks are cooperative, and async-io's operations on a
/// ready descriptor never suspend, so that a babbling line would stop every other one.
#[derive(Debug, Default)]
pub(crate) struct Share {
    used: u8,
}

impl Share {
    /// To be awaited before an operation, never after one, because a result must not be lost by a dropped future.
    pub(crate) async fn take(&mut self) {
        self.used += 1;
        if self.used >= TURNS_MAX {
            self.used = 0;
            yield_now().await;
        }
    }
}
