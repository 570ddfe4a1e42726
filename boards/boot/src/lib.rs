//! What the boot loaders of mobgate's boards share.
//!
//! A boot loader [`prepare`]s the flash: an image that waits in the update's partition is swapped with the active one, page by page; one
//! that was swapped in and did not confirm itself is swapped back. Both go on where a power cut has interrupted them: the state's
//! partition says how far they came. Then the boot loader starts what is active.
//!
//! The partitions are regions of the linker's memory map: see `link/partitions.x`.
#![no_std]
#![forbid(unsafe_code)]

mod partition;

use core::cell::RefCell;
use core::ops::Range;

use embassy_boot::{AlignedBuffer, BootLoader, BootLoaderConfig};
pub use embassy_boot::{BootError, State};
use embedded_storage::nor_flash::NorFlash;

pub use partition::Partition;

/// Bytes that are copied at a time: a whole part of each chip's page, and many of its words.
const COPY_BYTES: usize = 4096;

/// Partitions of a flash, as offsets from its beginning.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// The image that runs.
    pub active: Range<u32>,
    /// The image that waits, or the one before: a page more than `active`.
    pub update: Range<u32>,
    /// What is to be done, and how far that came.
    pub state: Range<u32>,
}

/// Swaps the images if that is due, or goes on with it, and returns what the state was before. `flash` is erased in pages of `PAGE` bytes, the largest
/// of `active` and `update`, and its state in pages of `STATE_PAGE`. The watchdog is fed before each operation.
pub fn prepare<F: NorFlash, const PAGE: usize, const STATE_PAGE: usize>(
    flash: &RefCell<F>,
    layout: &Layout,
    feed: fn(),
) -> Result<State, BootError> {
    let mut loader = BootLoader::new(BootLoaderConfig {
        active: Partition::<F, PAGE>::new(flash, layout.active.clone(), feed),
        dfu: Partition::<F, PAGE>::new(flash, layout.update.clone(), feed),
        state: Partition::<F, STATE_PAGE>::new(flash, layout.state.clone(), feed),
    });
    let mut buffer = AlignedBuffer([0; COPY_BYTES]);
    loader.prepare_boot(buffer.as_mut())
}
