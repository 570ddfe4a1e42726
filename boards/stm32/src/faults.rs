//! Panics and faults: recorded for `show log`, then the board restarts.

use core::arch::asm;
use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use mobgate_faults::{Fault, Panic, note};

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    note(format_args!("{}", Panic::here()));
    defmt::error!("panic");
    SCB::sys_reset()
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    note(format_args!("{}", Fault(frame)));
    SCB::sys_reset()
}

/// An interrupt without a handler, or an NMI (number -14): an ECC error of the flash, or a clock failure.
#[exception]
unsafe fn DefaultHandler(number: i16) {
    note(format_args!("interrupt {number}, which nobody serves"));
    SCB::sys_reset()
}

/// Panics of embassy's drivers, whose location only defmt gets. The fault's record has the caller's address.
#[defmt::panic_handler]
fn driver_panic() -> ! {
    // SAFETY: an undefined instruction raises a fault, which does not return.
    unsafe { asm!("udf #0", options(noreturn)) }
}
