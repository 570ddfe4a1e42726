//! Interrupt numbers.

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;

/// An interrupt number.
#[derive(Clone, Copy)]
pub(crate) struct Interrupt(pub(crate) u16);

pub(crate) const TIMER_0: Interrupt = Interrupt(8);
pub(crate) const TIMER_1: Interrupt = Interrupt(9);
pub(crate) const ETHERNET: Interrupt = Interrupt(13);
/// The receivers' interrupts; each transmitter's has the next number.
pub(crate) const UARTS: [Interrupt; 5] =
    [Interrupt(0), Interrupt(2), Interrupt(4), Interrupt(18), Interrupt(20)];

// SAFETY: the numbers are constants below the processor's number of interrupts.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self.0
    }
}

/// Unmasks `interrupt`.
pub(crate) fn enable(interrupt: Interrupt) {
    // SAFETY: no critical section here relies on masking single interrupts.
    unsafe { NVIC::unmask(interrupt) }
}
