//! The embassy-time driver for hosts, on the wall clock or a per-thread virtual clock, and the critical section that embassy-sync
//! needs.
//!
//! A waiting task stores its waker in the calling thread's queue. That thread's loop reads [`next_alarm`], sleeps until then by any
//! means, and calls [`fire_due`]. Tests and simulations replace the time by [`virtual_time`]. Queue and virtual clock are per
//! thread, so many simulations run in parallel in one process.

use std::cell::Cell;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;
use std::task::Waker;

use embassy_time_driver::Driver;

mod queue;
mod section;
pub mod virtual_time;

pub use queue::{fire_due, next_alarm};

struct HostClock;

embassy_time_driver::time_driver_impl!(static CLOCK: HostClock = HostClock);

const _: () = assert!(embassy_time_driver::TICK_HZ == 1_000_000, "a tick of this clock is a microsecond");

thread_local! {
    /// The thread's last reading of the clock.
    static SEEN: Cell<u64> = const { Cell::new(0) };
}

impl Driver for HostClock {
    fn now(&self) -> u64 {
        let now = virtual_time::now().unwrap_or_else(wall_clock);
        SEEN.set(now);
        now
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        // A timer reads the clock just before it waits, so the last reading is good enough. Time passed since then is caught by the
        // thread's loop, which reads the clock before it sleeps.
        if at <= virtual_time::now().unwrap_or_else(|| SEEN.get()) {
            waker.wake_by_ref();
        } else {
            queue::insert(at, waker);
        }
    }
}

/// The host's monotonic time at the first reading, in microseconds; 0 before that.
static STARTED: AtomicU64 = AtomicU64::new(0);

/// Microseconds since the first reading, because a board's clock also starts at 0. Bypasses std's `Instant` and its redundant
/// checks: this is called some twenty times per transaction.
fn wall_clock() -> u64 {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `now` is valid for writes. Every host has this clock, so the call cannot fail.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut now) };
    let now = now.tv_sec as u64 * 1_000_000 + now.tv_nsec as u64 / 1_000;
    let started = match STARTED.load(Relaxed) {
        0 => STARTED.compare_exchange(0, now, Relaxed, Relaxed).err().unwrap_or(now),
        started => started,
    };
    // Two threads may race for the first reading; the loser may have read an earlier time.
    now.saturating_sub(started)
}
