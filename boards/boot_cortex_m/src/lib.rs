//! A boot loader on a Cortex-M, whatever the chip: the partitions as the linker has them, and the start of an image.
//!
//! `main.rs` is every board's boot loader, on a crate for its chip.
#![no_std]

use core::cell::RefCell;
use core::ops::Range;

use cortex_m::peripheral::{NVIC, SCB};
use embedded_storage::nor_flash::NorFlash;
use mobgate_boot::{BootError, Layout, prepare};

unsafe extern "C" {
    // Addresses, by boot/link/partitions.x.
    safe static __active_start: u8;
    safe static __active_end: u8;
    safe static __update_start: u8;
    safe static __update_end: u8;
    safe static __state_start: u8;
    safe static __state_end: u8;
}

/// The partitions of a flash that begins at the address `base`, as the board's `regions.x` has them.
pub fn layout(base: usize) -> Layout {
    let between = |start: &u8, end: &u8| -> Range<u32> {
        let offset = |at: &u8| (core::ptr::from_ref(at).addr() - base) as u32;
        offset(start)..offset(end)
    };
    Layout {
        active: between(&__active_start, &__active_end),
        update: between(&__update_start, &__update_end),
        state: between(&__state_start, &__state_end),
    }
}

/// Swaps the images if that is due, and starts the active one; returns if that is not possible. `flash` begins at the address `base`; for pages
/// and `feed`, see [`prepare`].
pub fn run<F: NorFlash, const PAGE: usize, const STATE_PAGE: usize>(
    flash: F,
    base: usize,
    feed: fn(),
) -> BootError {
    let layout = layout(base);
    let prepared = prepare::<F, PAGE, STATE_PAGE>(&RefCell::new(flash), &layout, feed);
    feed();
    match prepared {
        Ok(_) => start(base as u32 + layout.active.start),
        Err(error) => error,
    }
}

/// Starts the image there.
fn start(table: u32) -> ! {
    // SAFETY: the partition begins with an image's vector table: its stack pointer and its reset vector. Where there is no image, the
    // fault starts the chip anew. The image must find no interrupt enabled, and nothing else runs here that uses the registers.
    unsafe {
        (*NVIC::PTR).icer.iter().for_each(|enabled| enabled.write(u32::MAX));
        (*SCB::PTR).vtor.write(table);
        cortex_m::asm::dsb();
        cortex_m::asm::bootload(table as *const u32)
    }
}
