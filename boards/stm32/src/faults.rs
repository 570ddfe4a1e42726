//! A panic or a fault: its words are kept for `show log`, and the board starts again.

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
