//! embassy-time's clock on a 32-bit microsecond counter, which wraps every 71 minutes. Stalls shorter than that lose no time: a
//! chip stalls for seconds while it erases the flash that it runs from.

use core::cell::{Cell, RefCell};
use core::task::Waker;

use embassy_sync::blocking_mutex::CriticalSectionMutex;
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

const _: () = assert!(embassy_time_driver::TICK_HZ == 1_000_000, "a tick is a microsecond");

/// Longest time between two alarms: far below the 71 minutes in which the counter wraps.
const SLEEP_MAX_TICKS: u64 = 60_000_000;

/// A chip's counter.
pub trait Counter {
    /// Microseconds since the start, modulo 2^32.
    fn count(&self) -> u32;

    /// Sets an interrupt that calls [`Clock::on_alarm`] in `ticks` microseconds, at least 1; replaces the previous alarm. If the
    /// time passes meanwhile, the interrupt fires at once.
    fn set_alarm(&self, ticks: u32);
}

/// A clock on the counter `C`, for `time_driver_impl!`.
pub struct Clock<C> {
    counter: C,
    state: CriticalSectionMutex<State>,
}

struct State {
    queue: RefCell<Queue>,
    rounds: Cell<Rounds>,
    /// When the alarm fires.
    alarm: Cell<u64>,
}

impl State {
    /// The time at counter value `count`. Inlined: every task reads the clock many times.
    #[inline(always)]
    fn now(&self, count: u32) -> u64 {
        let (rounds, now) = self.rounds.get().at(count);
        self.rounds.set(rounds);
        now
    }
}

impl<C: Counter> Clock<C> {
    /// A stopped clock.
    pub const fn new(counter: C) -> Self {
        let state = State {
            queue: RefCell::new(Queue::new()),
            rounds: Cell::new(Rounds { last: 0, rounds: 0 }),
            alarm: Cell::new(0),
        };
        Self { counter, state: CriticalSectionMutex::new(state) }
    }

    /// Starts the clock; the counter must be running.
    pub fn start(&self) {
        self.on_alarm();
    }

    /// Wakes all tasks that are due; called by the counter's interrupt.
    pub fn on_alarm(&self) {
        self.state.lock(|state| {
            let next = state.queue.borrow_mut().next_expiration(state.now(self.counter.count()));
            self.set_alarm(state, next);
        });
    }

    fn set_alarm(&self, state: &State, at: u64) {
        let now = state.now(self.counter.count());
        let ticks = at.saturating_sub(now).clamp(1, SLEEP_MAX_TICKS);
        state.alarm.set(now + ticks);
        self.counter.set_alarm(ticks as u32);
    }
}

impl<C: Counter + Send + Sync + 'static> Driver for Clock<C> {
    fn now(&self) -> u64 {
        self.state.lock(|state| state.now(self.counter.count()))
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        self.state.lock(|state| {
            // The queue is walked through only when the alarm fires: here nothing else can have become due earlier.
            if state.queue.borrow_mut().schedule_wake(at, waker) && at < state.alarm.get() {
                self.set_alarm(state, at);
            }
        });
    }
}

/// Extends the counter by the number of its wraps.
#[derive(Clone, Copy)]
struct Rounds {
    last: u32,
    rounds: u32,
}

impl Rounds {
    /// At counter value `count`, with the time; must be called at least once per wrap.
    #[inline(always)]
    fn at(self, count: u32) -> (Self, u64) {
        let rounds = self.rounds + u32::from(count < self.last);
        (Self { last: count, rounds }, u64::from(rounds) << 32 | u64::from(count))
    }
}

#[cfg(test)]
mod tests {
    use core::sync::atomic::AtomicU32;
    use core::sync::atomic::Ordering::Relaxed;

    use embassy_time_driver::Driver;
    use mobgate_clock as _;

    use super::{Clock, Counter};

    #[derive(Default)]
    struct Chip {
        count: AtomicU32,
        alarm: AtomicU32,
    }

    impl Counter for Chip {
        fn count(&self) -> u32 {
            self.count.load(Relaxed)
        }

        fn set_alarm(&self, ticks: u32) {
            self.alarm.store(ticks, Relaxed);
        }
    }

    #[test]
    fn time_goes_on_over_the_counters_end_and_over_standing_still() {
        let clock = Clock::new(Chip::default());
        clock.start();
        let mut now = 0;
        // One reading per minute, an erase of two seconds, and half an hour without a reading: more than three wraps.
        for step in [60_000_000, 2_000_000, 1_800_000_000].into_iter().cycle().take(24) {
            now += step;
            clock.counter.count.store(now as u32, Relaxed);
            assert_eq!(clock.now(), now);
        }
        assert!(now > 3 << 32);
    }

    #[test]
    fn without_anything_to_wait_for_the_alarm_still_looks_at_the_counter() {
        let clock = Clock::new(Chip::default());
        clock.start();
        assert_eq!(clock.counter.alarm.load(Relaxed), 60_000_000);
    }
}
