//! The boot loader of the STM32 boards, and what it shares with the program: [`flash`], [`watchdog`].
//!
//! It runs on the clock of the reset, from the first part of the flash, and uses nothing of the chip but the flash and the watchdog,
//! where the flash is what it has to be.
//! What goes wrong starts the chip anew: the swap goes on where it was.
#![no_std]

pub mod flash;
#[cfg(feature = "f7")] // The others' flash is as it is.
mod one_bank;
pub mod watchdog;

use cortex_m::peripheral::SCB;
use embassy_stm32::flash::FLASH_BASE;

use crate::flash::{Chip, PAGE_BYTES, STATE_PAGE_BYTES};

/// Starts the chip anew.
pub fn restart() -> ! {
    SCB::sys_reset()
}

/// Swaps the images if that is due, and starts the active one.
pub fn run() -> ! {
    // Before anything that may hang. It goes on in the program: one that hangs at its start is swapped back.
    watchdog::start();
    #[cfg(feature = "f7")]
    one_bank::check();
    flash::hold_second_bank();
    mobgate_boot_cortex_m::run::<_, PAGE_BYTES, STATE_PAGE_BYTES>(Chip::new(), FLASH_BASE, watchdog::feed);
    restart()
}
