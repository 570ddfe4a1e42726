//! Writes a firmware into a partition, page after page, and hashes what was found there afterwards.

use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::UpdateError;
use salty::Sha512;

/// Bytes that are written at a time: whole words of each chip's flash.
const CHUNK_BYTES: usize = 256;
/// Bytes that are read back at a time.
const PIECE_BYTES: usize = 64;
/// An erased byte.
pub(crate) const BLANK: u8 = 0xff;

/// The firmware so far.
pub(crate) struct Writer {
    chunk: [u8; CHUNK_BYTES],
    /// Bytes in the chunk, which are not written.
    waiting: usize,
    /// Bytes that are written.
    written: u32,
    hash: Sha512,
}

impl Writer {
    pub(crate) fn new() -> Self {
        Self { chunk: [BLANK; CHUNK_BYTES], waiting: 0, written: 0, hash: Sha512::new() }
    }

    /// Writes the next bytes.
    pub(crate) async fn write(
        &mut self,
        flash: &mut impl NorFlash,
        mut bytes: &[u8],
    ) -> Result<(), UpdateError> {
        while !bytes.is_empty() {
            let (now, later) = bytes.split_at(bytes.len().min(CHUNK_BYTES - self.waiting));
            self.chunk[self.waiting..][..now.len()].copy_from_slice(now);
            self.waiting += now.len();
            if self.waiting == CHUNK_BYTES {
                self.flush(flash).await?;
            }
            bytes = later;
        }
        Ok(())
    }

    /// Writes what waits, and returns the hash of all that is in the flash then.
    pub(crate) async fn finish(&mut self, flash: &mut impl NorFlash) -> Result<[u8; 64], UpdateError> {
        self.flush(flash).await?;
        Ok(core::mem::take(&mut self.hash).finalize())
    }

    async fn flush<F: NorFlash>(&mut self, flash: &mut F) -> Result<(), UpdateError> {
        const { assert!(CHUNK_BYTES.is_multiple_of(F::WRITE_SIZE) && F::ERASE_SIZE.is_multiple_of(CHUNK_BYTES)) };
        if self.waiting == 0 {
            return Ok(());
        }
        let failed = |_| UpdateError::Failed;
        let page = F::ERASE_SIZE as u32;
        if self.written.is_multiple_of(page) {
            flash.erase(self.written, self.written + page).await.map_err(failed)?;
        }
        self.chunk[self.waiting..].fill(BLANK);
        let words = self.waiting.next_multiple_of(F::WRITE_SIZE);
        flash.write(self.written, &self.chunk[..words]).await.map_err(failed)?;
        // In pieces: a future keeps the buffer.
        let mut there = [0; PIECE_BYTES];
        for (at, wanted) in (self.written..).step_by(PIECE_BYTES).zip(self.chunk[..words].chunks(PIECE_BYTES))
        {
            let there = &mut there[..wanted.len()];
            flash.read(at, there).await.map_err(failed)?;
            if there != wanted {
                return Err(UpdateError::Failed);
            }
        }
        self.hash.update(&self.chunk[..self.waiting]);
        self.written += words as u32;
        self.waiting = 0;
        Ok(())
    }
}
