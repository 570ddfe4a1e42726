//! The boot loader of the RP2040 boards, and what it shares with the program: [`flash`], [`watchdog`].
//!
//! The chip's ROM copies the second stage from the flash's first 256 bytes, which makes the flash readable as memory, and starts the
//! boot loader behind it. What goes wrong starts the chip anew: the swap goes on where it was.
#![no_std]

pub mod flash;
pub mod watchdog;

use embassy_rp::flash::FLASH_BASE;
pub use watchdog::restart;

use crate::flash::{Chip, PAGE_BYTES, STATE_PAGE_BYTES};

/// Swaps the images if that is due, and starts the active one.
pub fn run() -> ! {
    // From the ring oscillator a swap may take a minute, and the watchdog has no tick.
    let peripherals = embassy_rp::init(Default::default());
    // It goes on in the program: one that hangs at its start is swapped back.
    watchdog::start();
    let flash = Chip::new(peripherals.FLASH);
    mobgate_boot_cortex_m::run::<_, PAGE_BYTES, STATE_PAGE_BYTES>(flash, FLASH_BASE.addr(), watchdog::feed);
    restart()
}
