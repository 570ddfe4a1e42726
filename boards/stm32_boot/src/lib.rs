//! The boot loader of the STM32 boards, and what it shares with the program: [`flash`], [`watchdog`].
//!
//! It runs on the clock of the reset, from the first part of the flash, and uses nothing of the chip but the flash and the watchdog.
//! What goes wrong starts the chip anew: the swap goes on where it was.
#![no_std]

pub mod flash;
pub mod watchdog;

use core::cell::RefCell;
use core::ops::Range;

use cortex_m::peripheral::SCB;
use embassy_stm32::flash::FLASH_BASE;
use mobgate_boot::prepare;

use crate::flash::{PAGE_BYTES, STATE_PAGE_BYTES};

/// Starts the chip anew.
pub fn restart() -> ! {
    SCB::sys_reset()
}

/// Swaps the images if that is due, and starts the active one.
pub fn run() -> ! {
    // Before anything that may hang. It goes on in the program: one that hangs at its start is swapped back.
    watchdog::start();
    flash::hold_second_bank();
    let layout = flash::layout();
    let flash = RefCell::new(flash::Chip::new());
    match prepare::<_, PAGE_BYTES, STATE_PAGE_BYTES>(&flash, &layout, watchdog::feed) {
        Ok(_) => start(&layout.active),
        Err(_) => restart(),
    }
}

/// Starts the image there.
fn start(active: &Range<u32>) -> ! {
    watchdog::feed();
    let table = FLASH_BASE as u32 + active.start;
    // SAFETY: the partition begins with an image's vector table: its stack pointer and its reset vector. No interrupt is enabled.
    // Where there is no image, the fault starts the chip anew.
    unsafe {
        (*SCB::PTR).vtor.write(table);
        cortex_m::asm::dsb();
        cortex_m::asm::bootload(table as *const u32)
    }
}
