//! embassy-time's driver: microseconds of the board's counter, alarms by a timer.

use core::cell::RefCell;
use core::task::Waker;

use critical_section::{CriticalSection, Mutex};
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

use crate::interrupts::{self, TIMER_0};
use crate::register::Register;

const FPGA_IO: usize = 0x4002_8000;
const COUNTER: Register = Register::at(FPGA_IO, 0x18);
const PRESCALE: Register = Register::at(FPGA_IO, 0x1c);
const TIMER: usize = 0x4000_0000;
const CONTROL: Register = Register::at(TIMER, 0x0);
const RELOAD: Register = Register::at(TIMER, 0x8);
const CLEAR: Register = Register::at(TIMER, 0xc);
const ENABLE_WITH_INTERRUPT: u32 = 1 | 1 << 3;

/// The timer and the counter's prescaler run at 25 MHz.
const CYCLES_PER_TICK: u32 = 25;
/// Longest time between two interrupts: well below the 71 minutes in which the counter comes round.
const SLEEP_MAX_TICKS: u64 = 60_000_000;

struct Clock(Mutex<RefCell<State>>);

struct State {
    queue: Queue,
    /// The counter when it was last read, and how often it had come round.
    last: u32,
    rounds: u32,
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock(Mutex::new(RefCell::new(State {
    queue: Queue::new(),
    last: 0,
    rounds: 0,
}))));

/// Starts the clock.
pub(crate) fn start() {
    PRESCALE.write(CYCLES_PER_TICK - 1);
    COUNTER.write(0);
    interrupts::enable(TIMER_0);
    CLOCK.with(|state, _| state.set_alarm(u64::MAX));
}

impl Clock {
    fn with<R>(&self, f: impl FnOnce(&mut State, u64) -> R) -> R {
        critical_section::with(|section: CriticalSection| {
            let mut state = self.0.borrow_ref_mut(section);
            let now = state.now();
            f(&mut state, now)
        })
    }
}

impl Driver for Clock {
    fn now(&self) -> u64 {
        self.with(|_, now| now)
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        self.with(|state, now| {
            if state.queue.schedule_wake(at, waker) {
                let next = state.queue.next_expiration(now);
                state.set_alarm(next);
            }
        });
    }
}

impl State {
    fn now(&mut self) -> u64 {
        let count = COUNTER.read();
        if count < self.last {
            self.rounds += 1;
        }
        self.last = count;
        u64::from(self.rounds) << 32 | u64::from(count)
    }

    /// Sets the timer to `at`; a time that has passed becomes the next moment.
    fn set_alarm(&mut self, at: u64) {
        let ticks = at.saturating_sub(self.now()).clamp(1, SLEEP_MAX_TICKS);
        CONTROL.write(0);
        CLEAR.write(1);
        RELOAD.write(ticks as u32 * CYCLES_PER_TICK);
        CONTROL.write(ENABLE_WITH_INTERRUPT);
    }
}

pub(crate) extern "C" fn on_timer() {
    CLEAR.write(1);
    CLOCK.with(|state, now| {
        let next = state.queue.next_expiration(now);
        state.set_alarm(next);
    });
}
