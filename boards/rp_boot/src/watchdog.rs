//! The chip's watchdog, which also starts it anew.

use embassy_rp::pac::{PSM, WATCHDOG};

/// The longest time without feeding: nearly the most (8.3 s).
const PERIOD_US: u32 = 8_000_000;
/// All of the chip but its oscillators, which are bits 0 and 1 of PSM.WDSEL (RP2040 data sheet, 2.13.5).
const ALL: u32 = 0x1fffc;

/// Starts it.
pub fn start() {
    PSM.wdsel().write(|reset| reset.0 = ALL);
    feed();
    WATCHDOG.ctrl().modify(|control| control.set_enable(true));
}

/// Gives it another 8 s.
pub fn feed() {
    // It counts two for each microsecond (erratum RP2040-E1).
    WATCHDOG.load().write(|load| load.set_load(2 * PERIOD_US));
}

/// Starts the chip anew. The RAM keeps its contents.
pub fn restart() -> ! {
    PSM.wdsel().write(|reset| reset.0 = ALL);
    WATCHDOG.ctrl().write(|control| control.set_trigger(true));
    loop {
        cortex_m::asm::nop();
    }
}
