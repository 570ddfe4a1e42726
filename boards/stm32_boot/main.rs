//! The boot loader of an STM32 board: `mobgate_stm32_boot` in the first part of the board's flash.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use cortex_m_rt::{ExceptionFrame, entry, exception};
use mobgate_stm32_boot::restart;

// The linker's memory map: a change must relink the image.
const _: &[u8] = include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/regions.x"));

#[entry]
fn main() -> ! {
    mobgate_stm32_boot::run()
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
