//! embassy-time's clock on TIM5, which has 32 bits on every family. embassy-stm32's own driver counts 16 bits and needs an
//! interrupt every 33 ms: an F767 erasing its flash would miss some, and lose that time.

use embassy_stm32::pac::TIM5;
use embassy_stm32::{interrupt, peripherals, rcc};
use mobgate_board::clock::{Clock, Counter};

struct Timer;

embassy_time_driver::time_driver_impl!(static CLOCK: Clock<Timer> = Clock::new(Timer));

/// Starts the clock; the chip's clock tree must be set up.
pub(crate) fn start() {
    rcc::enable_and_reset::<peripherals::TIM5>();
    let cycles_per_tick = rcc::frequency::<peripherals::TIM5>().0 / 1_000_000;
    TIM5.psc().write_value(cycles_per_tick as u16 - 1);
    // An update event loads the prescaler.
    TIM5.egr().write(|event| event.set_ug(true));
    TIM5.cr1().write(|control| control.set_cen(true));
    TIM5.dier().write(|enabled| enabled.set_ccie(0, true));
    CLOCK.start();
    // SAFETY: no critical section here relies on masking single interrupts.
    unsafe { cortex_m::peripheral::NVIC::unmask(embassy_stm32::pac::Interrupt::TIM5) };
}

impl Counter for Timer {
    fn count(&self) -> u32 {
        TIM5.cnt().read()
    }

    fn set_alarm(&self, ticks: u32) {
        let from = self.count();
        TIM5.ccr(0).write_value(from.wrapping_add(ticks));
        // Flags are cleared by writing zeros, and kept by ones.
        TIM5.sr().write(|flags| {
            flags.0 = u32::MAX;
            flags.set_ccif(0, false);
        });
        if self.count().wrapping_sub(from) >= ticks {
            TIM5.egr().write(|event| event.set_ccg(0, true));
        }
    }
}

#[interrupt]
fn TIM5() {
    CLOCK.on_alarm();
}
