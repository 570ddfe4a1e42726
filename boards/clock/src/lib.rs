//! The embassy-time driver of hosts: the wall clock, or a virtual clock of one thread.
//!
//! A task that waits for a time leaves its waker in the calling thread's queue; that thread's loop reads
//! [`next_alarm`], sleeps until then by whatever means it has, and calls [`fire_due`]. Tests and simulations
//! replace the time itself by [`virtual_time`]. Queue and virtual clock belong to a thread, so that many
//! simulations run side by side in one process.

use std::sync::OnceLock;
use std::task::Waker;
use std::time::Instant;

// Linked for its `std` implementation, which the locks of embassy-sync need on a host.
use critical_section as _;
use embassy_time_driver::Driver;

mod queue;
pub mod virtual_time;

pub use queue::{fire_due, next_alarm};

struct HostClock;

embassy_time_driver::time_driver_impl!(static CLOCK: HostClock = HostClock);

const _: () = assert!(embassy_time_driver::TICK_HZ == 1_000_000, "a tick of this clock is a microsecond");

impl Driver for HostClock {
    fn now(&self) -> u64 {
        virtual_time::now().unwrap_or_else(wall_clock)
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        if at <= self.now() {
            waker.wake_by_ref();
        } else {
            queue::insert(at, waker);
        }
    }
}

/// Microseconds since the first look at the clock.
fn wall_clock() -> u64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_micros() as u64
}
