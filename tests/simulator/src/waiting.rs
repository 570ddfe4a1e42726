//! Waiting on the wall clock for what other programs and threads do.

use std::thread::sleep;
use std::time::{Duration, Instant};

/// Longest wait for anything that is expected.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Waits until `done` gives something.
///
/// # Panics
/// When that takes longer than [`PATIENCE`].
pub fn wait_for<T>(what: &str, mut done: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(value) = done() {
            return value;
        }
        assert!(start.elapsed() < PATIENCE, "waited in vain for {what}");
        sleep(Duration::from_millis(10)); // between two looks
    }
}
