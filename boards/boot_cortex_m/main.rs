//! The boot loader of a board, in the first part of its flash: `chip_boot` is the crate for its chip.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use chip_boot::restart;
use cortex_m_rt::{ExceptionFrame, entry, exception};

// The linker's memory map: a change must relink the image.
const _: &[u8] = include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/regions.x"));

#[entry]
fn main() -> ! {
    chip_boot::run()
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    restart()
}

#[exception]
unsafe fn HardFault(_: &ExceptionFrame) -> ! {
    restart()
}

#[exception]
unsafe fn DefaultHandler(_: i16) {
    restart()
}
