//! embassy-time's clock: the board's microsecond counter, with alarms by a timer.

use mobgate_board::clock::{Clock, Counter};

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

struct Timer;

embassy_time_driver::time_driver_impl!(static CLOCK: Clock<Timer> = Clock::new(Timer));

/// Starts the clock.
pub(crate) fn start() {
    PRESCALE.write(CYCLES_PER_TICK - 1);
    COUNTER.write(0);
    interrupts::enable(TIMER_0);
    CLOCK.start();
}

impl Counter for Timer {
    fn count(&self) -> u32 {
        COUNTER.read()
    }

    fn set_alarm(&self, ticks: u32) {
        CONTROL.write(0);
        CLEAR.write(1);
        RELOAD.write(ticks * CYCLES_PER_TICK);
        CONTROL.write(ENABLE_WITH_INTERRUPT);
    }
}

pub(crate) extern "C" fn on_timer() {
    CLOCK.on_alarm();
}
