//! A partition of a flash that several share: each operation locks it.

use core::ops::Range;

use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// A part of a flash that is erased in pages of `PAGE` bytes.
pub struct Partition<'a, M: RawMutex, F, const PAGE: usize> {
    flash: &'a Mutex<M, F>,
    place: Range<u32>,
}

impl<'a, M: RawMutex, F, const PAGE: usize> Partition<'a, M, F, PAGE> {
    /// The part `place` of `flash`.
    pub const fn new(flash: &'a Mutex<M, F>, place: Range<u32>) -> Self {
        Self { flash, place }
    }

    /// Where `bytes` bytes at `offset` are in the flash.
    fn place(&self, offset: u32, bytes: usize) -> Result<u32, NorFlashErrorKind> {
        let at = self.place.start + offset;
        let fits = at <= self.place.end && bytes <= (self.place.end - at) as usize;
        if fits { Ok(at) } else { Err(NorFlashErrorKind::OutOfBounds) }
    }
}

impl<M: RawMutex, F: NorFlash, const PAGE: usize> ErrorType for Partition<'_, M, F, PAGE> {
    type Error = NorFlashErrorKind;
}

impl<M: RawMutex, F: NorFlash, const PAGE: usize> ReadNorFlash for Partition<'_, M, F, PAGE> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let at = self.place(offset, bytes.len())?;
        self.flash.lock().await.read(at, bytes).await.map_err(|error| error.kind())
    }

    fn capacity(&self) -> usize {
        self.place.len()
    }
}

impl<M: RawMutex, F: NorFlash, const PAGE: usize> NorFlash for Partition<'_, M, F, PAGE> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = PAGE;

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let at = self.place(offset, bytes.len())?;
        self.flash.lock().await.write(at, bytes).await.map_err(|error| error.kind())
    }

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        // One page at a time: others may use the flash in between.
        for page in (from..to).step_by(PAGE) {
            let at = self.place(page, PAGE)?;
            let mut flash = self.flash.lock().await;
            flash.erase(at, at + PAGE as u32).await.map_err(|error| error.kind())?;
        }
        Ok(())
    }
}
