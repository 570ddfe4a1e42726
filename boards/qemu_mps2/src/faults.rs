//! Panics and faults: reported, and turned into the emulator's exit status. With the word `restart` on its command line the board
//! restarts instead, as a real one does.

use core::fmt;
use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use cortex_m_semihosting::hprintln;
use mobgate_faults::{Fault, note};

use crate::semihosting::{self, CommandLine};

/// An unmapped address on this machine.
const NOWHERE: *const u32 = 0x9000_0000 as *const u32;

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    end(format_args!("{info}"))
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    end(format_args!("{}", Fault(frame)))
}

fn end(words: fmt::Arguments<'_>) -> ! {
    cortex_m::interrupt::disable();
    note(words);
    hprintln!("{}", words);
    if CommandLine::read().has("restart") {
        SCB::sys_reset()
    }
    semihosting::fail()
}

/// Reads from an unmapped address, to test fault handling.
#[inline(never)]
#[unsafe(no_mangle)]
pub(crate) extern "C" fn touch_nothing() {
    // SAFETY: the access ends in the handler above, and has no other effect.
    unsafe { NOWHERE.read_volatile() };
}
