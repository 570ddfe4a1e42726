//! The board's flash: its partitions, and words that a power cut does not turn into others.

use embassy_rp::Peri;
use embassy_rp::flash::{Blocking, ERASE_SIZE, Error, FLASH_BASE, Flash};
use embassy_rp::peripherals::FLASH;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use mobgate_boot::Layout;

/// Bytes of the flash: 16 Mbit, as on a Pico and a W5500-EVB-Pico.
pub const FLASH_BYTES: usize = 2 * 1024 * 1024;
/// Bytes of a page of the images' partitions: eight sectors, 0.4 s to erase (3.2 s at worst).
pub const PAGE_BYTES: usize = 32 * 1024;
/// Bytes of the state's page.
pub const STATE_PAGE_BYTES: usize = ERASE_SIZE;
/// Bytes of a word. The flash writes single bytes too, but one that a power cut has left half written may be another: the mark of a
/// confirmed image, d0h, has become f0h on its way, that of an image that waits.
const WORD_BYTES: usize = 32;
/// Bytes of the flash's unique number.
pub const UNIQUE_BYTES: usize = 8;

/// The partitions, as the board's `regions.x` has them.
pub fn layout() -> Layout {
    mobgate_boot_cortex_m::layout(FLASH_BASE.addr())
}

/// The chip's flash. It stands still with the processor while it is erased or written: nothing runs from it then, and interrupts wait.
pub struct Chip(Flash<'static, FLASH, Blocking, FLASH_BYTES>);

impl Chip {
    /// All of the flash.
    pub fn new(flash: Peri<'static, FLASH>) -> Self {
        Self(Flash::new_blocking(flash))
    }

    /// The flash's unique number.
    pub fn unique(&mut self) -> [u8; UNIQUE_BYTES] {
        let mut unique = [0; UNIQUE_BYTES];
        // A command to the flash, which cannot fail on the first core.
        let _ = self.0.blocking_unique_id(&mut unique);
        unique
    }
}

impl ErrorType for Chip {
    type Error = Error;
}

impl ReadNorFlash for Chip {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.blocking_read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        FLASH_BYTES
    }
}

impl NorFlash for Chip {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = ERASE_SIZE;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        self.0.blocking_write(offset, bytes)
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        self.0.blocking_erase(from, to)
    }
}
