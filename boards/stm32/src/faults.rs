//! A panic or a fault: its words are kept for `show log`, and the board starts again.

use core::arch::asm;
use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use mobgate_faults::{Fault, note};

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    note(format_args!("{info}"));
    defmt::error!("{}", defmt::Display2Format(info));
    SCB::sys_reset()
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    note(format_args!("{}", Fault(frame)));
    SCB::sys_reset()
}

/// An interrupt that nothing is bound to, or an NMI (number -14): of the flash's error correction, or of a clock that failed.
#[exception]
unsafe fn DefaultHandler(number: i16) {
    note(format_args!("interrupt {number}, which nobody serves"));
    SCB::sys_reset()
}

/// A panic of embassy's drivers, which tell defmt and nobody else where they are. The fault's record has the address that
/// this was called from.
#[defmt::panic_handler]
fn driver_panic() -> ! {
    // SAFETY: an undefined instruction is a fault, which does not return.
    unsafe { asm!("udf #0", options(noreturn)) }
}
