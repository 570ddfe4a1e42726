//! A per-thread clock that only advances when told to.

use std::cell::Cell;
use std::marker::PhantomData;

use crate::queue::{self, Alarms};

thread_local! {
    static NOW: Cell<Option<u64>> = const { Cell::new(None) };
}

/// The virtual time of this thread, if it has one.
pub(crate) fn now() -> Option<u64> {
    NOW.get()
}

/// Switches this thread to a virtual clock that starts at 0 without alarms, until the guard is dropped.
///
/// # Panics
/// If the thread already has a virtual clock: two simulations in one thread would share their time.
pub fn enter() -> VirtualClock {
    assert!(NOW.get().is_none(), "this thread is on a virtual clock already");
    NOW.set(Some(0));
    VirtualClock { wall_alarms: queue::replace(Alarms::NONE), _this_thread_only: PhantomData }
}

/// The thread's virtual clock. Dropping it restores the wall clock and its alarms.
#[must_use = "the wall clock comes back when this is dropped"]
pub struct VirtualClock {
    wall_alarms: Alarms,
    _this_thread_only: PhantomData<*const ()>,
}

impl VirtualClock {
    /// Sets the time to `tick` and wakes all tasks due by then.
    ///
    /// # Panics
    /// If `tick` is in the past.
    pub fn advance_to(&self, tick: u64) {
        assert!(NOW.get().is_some_and(|now| now <= tick), "time does not run backwards");
        NOW.set(Some(tick));
        queue::fire_due();
    }
}

impl Drop for VirtualClock {
    fn drop(&mut self) {
        NOW.set(None);
        queue::replace(std::mem::replace(&mut self.wall_alarms, Alarms::NONE));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::task::{Wake, Waker};

    use embassy_time::Instant;
    use embassy_time_driver::schedule_wake;

    use super::enter;
    use crate::{fire_due, next_alarm};

    #[derive(Default)]
    struct Wakes(AtomicU32);

    impl Wake for Wakes {
        fn wake(self: Arc<Self>) {
            self.0.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn counted() -> (Arc<Wakes>, Waker) {
        let wakes = Arc::<Wakes>::default();
        (wakes.clone(), wakes.into())
    }

    #[test]
    fn virtual_time_stands_still_and_leaps_where_it_is_told() {
        let clock = enter();
        assert_eq!(Instant::now().as_ticks(), 0);
        clock.advance_to(5);
        assert_eq!(Instant::now().as_ticks(), 5);
    }

    #[test]
    fn each_thread_has_a_virtual_clock_of_its_own() {
        let clock = enter();
        clock.advance_to(7);
        let other = std::thread::spawn(|| {
            let _clock = enter();
            Instant::now().as_ticks()
        });
        assert_eq!(other.join().unwrap(), 0);
        assert_eq!(Instant::now().as_ticks(), 7);
    }

    #[test]
    fn an_alarm_wakes_once_at_its_time() {
        let clock = enter();
        let (wakes, waker) = counted();
        schedule_wake(10, &waker);
        clock.advance_to(9);
        assert_eq!(wakes.0.load(Ordering::Relaxed), 0);
        clock.advance_to(10);
        clock.advance_to(11);
        assert_eq!(wakes.0.load(Ordering::Relaxed), 1);
        assert_eq!(next_alarm(), None);
    }

    #[test]
    fn a_waker_keeps_its_earliest_alarm_only() {
        let _clock = enter();
        let (_wakes, waker) = counted();
        for at in [50, 20, 80] {
            schedule_wake(at, &waker);
        }
        assert_eq!(next_alarm(), Some(20));
    }

    #[test]
    fn a_time_that_has_passed_wakes_at_once() {
        let clock = enter();
        clock.advance_to(10);
        let (wakes, waker) = counted();
        schedule_wake(10, &waker);
        assert_eq!(wakes.0.load(Ordering::Relaxed), 1);
    }

    #[test]
    fn the_wall_clocks_alarms_come_back_when_the_virtual_clock_ends() {
        let (wakes, waker) = counted();
        let at = Instant::now().as_ticks() + 1_000;
        schedule_wake(at, &waker);
        drop(enter());
        assert_eq!(next_alarm(), Some(at));
        while Instant::now().as_ticks() < at {
            std::hint::spin_loop();
        }
        fire_due();
        assert_eq!(wakes.0.load(Ordering::Relaxed), 1);
    }
}
