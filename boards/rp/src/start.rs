//! Why the chip started, and what ends a run: panics and faults are recorded for `show log`.

use core::arch::asm;
use core::panic::PanicInfo;

use cortex_m_rt::{ExceptionFrame, exception};
use embassy_rp::pac;
use mobgate_faults::{Fault, Panic, note};
use mobgate_rp_boot::restart;

/// The cause of the chip's reset.
pub(crate) fn cause() -> &'static str {
    let watchdog = pac::WATCHDOG.reason().read();
    let chip = pac::VREG_AND_CHIP_RESET.chip_reset().read();
    // The chip's flags stay as they are over a reset by the watchdog, so that is checked first.
    match (watchdog.force(), watchdog.timer(), chip.had_por(), chip.had_run()) {
        (true, ..) => "started by reboot or after a fault",
        (_, true, ..) => "started by the watchdog",
        (_, _, true, _) => "started by power",
        (_, _, _, true) => "started by the reset pin",
        _ => "started by a debugger, or for a reason unknown",
    }
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    note(format_args!("{}", Panic::here()));
    defmt::error!("panic");
    restart()
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    note(format_args!("{}", Fault(frame)));
    restart()
}

#[exception]
unsafe fn DefaultHandler(number: i16) {
    note(format_args!("interrupt {number}, which nobody serves"));
    restart()
}

/// Panics of embassy's drivers, whose location only defmt gets. The fault's record has the caller's address.
#[defmt::panic_handler]
fn driver_panic() -> ! {
    // SAFETY: an undefined instruction raises a fault, which does not return.
    unsafe { asm!("udf #0", options(noreturn)) }
}
