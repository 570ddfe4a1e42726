//! A partition of a flash, that begins at 0, and a watchdog that is fed before each of its operations.

use core::cell::RefCell;
use core::ops::Range;

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

/// Longest word of a flash with error correction.
const WORD_BYTES_MAX: usize = 64;

/// A part of a flash that is erased in pages of `PAGE` bytes.
pub struct Partition<'a, F, const PAGE: usize> {
    flash: &'a RefCell<F>,
    place: Range<u32>,
    feed: fn(),
}

impl<'a, F, const PAGE: usize> Partition<'a, F, PAGE> {
    /// The part `place` of `flash`; `feed` feeds the watchdog.
    pub const fn new(flash: &'a RefCell<F>, place: Range<u32>, feed: fn()) -> Self {
        Self { flash, place, feed }
    }

    /// Where `bytes` bytes at `offset` are in the flash.
    fn place(&self, offset: u32, bytes: usize) -> Result<u32, NorFlashErrorKind> {
        let at = self.place.start + offset;
        let fits = self.place.contains(&at) && bytes <= (self.place.end - at) as usize;
        if fits { Ok(at) } else { Err(NorFlashErrorKind::OutOfBounds) }
    }
}

impl<F: NorFlash, const PAGE: usize> ErrorType for Partition<'_, F, PAGE> {
    type Error = NorFlashErrorKind;
}

impl<F: NorFlash, const PAGE: usize> ReadNorFlash for Partition<'_, F, PAGE> {
    const READ_SIZE: usize = F::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let at = self.place(offset, bytes.len())?;
        (self.feed)();
        self.flash.borrow_mut().read(at, bytes).map_err(|error| error.kind())
    }

    fn capacity(&self) -> usize {
        self.place.len()
    }
}

impl<F: NorFlash, const PAGE: usize> NorFlash for Partition<'_, F, PAGE> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = PAGE;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let at = self.place(offset, bytes.len())?;
        (self.feed)();
        let mut flash = self.flash.borrow_mut();
        // A word of the state that a power cut has left half written may read as what it was to be. With error correction it must
        // not be programmed again.
        let mut there = [0; WORD_BYTES_MAX];
        if let Some(there) = there.get_mut(..bytes.len()).filter(|there| there.len() == F::WRITE_SIZE) {
            flash.read(at, there).map_err(|error| error.kind())?;
            if there == bytes {
                return Ok(());
            }
        }
        flash.write(at, bytes).map_err(|error| error.kind())
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        // One page at a time: a chip takes seconds for a large one.
        for page in (from..to).step_by(PAGE) {
            let at = self.place(page, PAGE)?;
            (self.feed)();
            self.flash.borrow_mut().erase(at, at + PAGE as u32).map_err(|error| error.kind())?;
        }
        Ok(())
    }
}
