//! The embassy-time driver of hosts, the wall clock or a virtual clock of one thread; and their critical section, which the
//! locks of embassy-sync need.
//!
//! A task that waits for a time leaves its waker in the calling thread's queue; that thread's loop reads
//! [`next_alarm`], sleeps until then by whatever means it has, and calls [`fire_due`]. Tests and simulations
//! replace the time itself by [`virtual_time`]. Queue and virtual clock belong to a thread, so that many
//! simulations run side by side in one process.

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
    /// What the thread's last look at the clock gave.
    static SEEN: Cell<u64> = const { Cell::new(0) };
}

impl Driver for HostClock {
    fn now(&self) -> u64 {
        let now = virtual_time::now().unwrap_or_else(wall_clock);
        SEEN.set(now);
        now
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        // Who waits has looked at the clock just before. What has passed since then is found by the thread's loop, which looks
        // before it sleeps.
        if at <= virtual_time::now().unwrap_or_else(|| SEEN.get()) {
            waker.wake_by_ref();
        } else {
            queue::insert(at, waker);
        }
    }
}

/// When the clock was looked at first, in microseconds of the host's own; 0 before that.
static STARTED: AtomicU64 = AtomicU64::new(0);

/// Microseconds since the first look, as a board's clock starts with it. Without the detour through std's `Instant`, which
/// checks what cannot be: this is called some twenty times for a transaction.
fn wall_clock() -> u64 {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `now` is a place for what is written. Every host has this clock, so the call cannot fail.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut now) };
    let now = now.tv_sec as u64 * 1_000_000 + now.tv_nsec as u64 / 1_000;
    let started = match STARTED.load(Relaxed) {
        0 => STARTED.compare_exchange(0, now, Relaxed, Relaxed).err().unwrap_or(now),
        started => started,
    };
    // Of two threads that look first, the one that came later may have read its time earlier.
    now.saturating_sub(started)
}
