//! Two flash sectors with atomic erase: a sector left half erased by a power cut is erased again at start-up.
//!
//! By its first and last word, which is all that sequential-storage reads, a half-erased sector may still look full, or empty. So
//! each sector begins with two marks, hidden from the layers above: `erased` is written after a successful erase, `erasing` before
//! the next one begins. A sector is good if the first is set and the second is blank. The marks lie side by side at the sector's
//! start, so an erase that runs from one end to the other clears `erased` before `erasing`, or clears `erasing` when all else is
//! gone.

use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

/// Bytes of a mark: the longest flash word of any supported chip, and far more bits than could change by chance.
const MARK_BYTES: usize = 32;
/// Bytes at the start of each sector taken by the marks.
pub const MARKS_BYTES: usize = 2 * MARK_BYTES;
/// Erase succeeded. Half of the bits are zero, so neither an all-ones nor an all-zeros sector matches.
const ERASED: [u8; MARK_BYTES] = *b"mobgate settings, sector erased\n";
/// Erase started: the sector's content is void.
const ERASING: [u8; MARK_BYTES] = [0; MARK_BYTES];
const BLANK: u8 = 0xff;
/// Bytes of a read after which no other task need run: an item's head, or a small item.
const SHORT_READ_BYTES: usize = 64;

/// Number of sectors.
pub const SECTORS: u32 = 2;

/// Two sectors of a flash as one region that begins at 0, without the marks.
#[derive(Debug)]
pub struct Sectors<F> {
    flash: F,
    start: u32,
}

impl<F: NorFlash> Sectors<F> {
    /// Usable bytes of a sector.
    const SECTOR_BYTES: usize = F::ERASE_SIZE - MARKS_BYTES;

    /// The two sectors at `start` of `flash`.
    pub const fn new(flash: F, start: u32) -> Self {
        const { assert!(MARK_BYTES.is_multiple_of(F::WRITE_SIZE), "a mark is whole flash words") };
        const { assert!(F::ERASE_SIZE.is_power_of_two() && F::ERASE_SIZE > 4 * MARKS_BYTES) };
        Self { flash, start }
    }

    /// Erases sectors that are half erased or were never used. Must be called before any other method.
    pub async fn prepare(&mut self) -> Result<(), F::Error> {
        for index in 0..SECTORS {
            let mut marks = [0; MARKS_BYTES];
            self.flash.read(self.base(index), &mut marks).await?;
            if !is_good(&marks) {
                self.erase_sector(index).await?;
            }
        }
        Ok(())
    }

    /// Flash address of the sector.
    const fn base(&self, index: u32) -> u32 {
        self.start + index * F::ERASE_SIZE as u32
    }

    /// Flash address of `offset`. Accesses do not cross a sector's end, because those of the map do not.
    const fn place(&self, offset: u32) -> u32 {
        let (index, within) = (offset / Self::SECTOR_BYTES as u32, offset % Self::SECTOR_BYTES as u32);
        self.base(index) + MARKS_BYTES as u32 + within
    }

    async fn erase_sector(&mut self, index: u32) -> Result<(), F::Error> {
        let base = self.base(index);
        self.flash.erase(base, base + F::ERASE_SIZE as u32).await?;
        self.flash.write(base, &ERASED).await
    }
}

fn is_good(marks: &[u8; MARKS_BYTES]) -> bool {
    marks.strip_prefix(&ERASED).is_some_and(|erasing| erasing.iter().all(|&byte| byte == BLANK))
}

impl<F: NorFlash> ErrorType for Sectors<F> {
    type Error = F::Error;
}

impl<F: NorFlash> ReadNorFlash for Sectors<F> {
    // Whole flash words: the map judges by one read of this size whether a sector is open, full or empty, and a single byte of a
    // partially written word is less reliable than all of them.
    const READ_SIZE: usize = F::WRITE_SIZE;

    /// The map reads all items to find one of them, and checks each: other tasks run between.
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> impl Future<Output = Result<(), F::Error>> {
        let is_long = bytes.len() > SHORT_READ_BYTES;
        // Not an `async fn`, which would keep its arguments twice.
        let read = self.flash.read(self.place(offset), bytes);
        async move {
            read.await?;
            if is_long {
                yield_now().await;
            }
            Ok(())
        }
    }

    fn capacity(&self) -> usize {
        SECTORS as usize * Self::SECTOR_BYTES
    }
}

impl<F: NorFlash> NorFlash for Sectors<F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = Self::SECTOR_BYTES;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> impl Future<Output = Result<(), F::Error>> {
        self.flash.write(self.place(offset), bytes)
    }

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        let sector_bytes = Self::SECTOR_BYTES as u32;
        for index in from / sector_bytes..to / sector_bytes {
            let mark = self.base(index) + MARK_BYTES as u32;
            let mut there = [0; MARK_BYTES];
            self.flash.read(mark, &mut there).await?;
            // After a failed erase the mark is already set, and flash words with ECC must not be written twice.
            if there.iter().all(|&byte| byte == BLANK) {
                self.flash.write(mark, &ERASING).await?;
            }
            self.erase_sector(index).await?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{ERASED, ERASING, MARK_BYTES, MARKS_BYTES, is_good};

    #[test]
    fn a_sector_is_good_only_with_the_whole_first_mark_and_nothing_of_the_second() {
        let mut marks = [0xff; MARKS_BYTES];
        assert!(!is_good(&marks));
        marks[..MARK_BYTES].copy_from_slice(&ERASED);
        assert!(is_good(&marks));
        for at in 0..MARKS_BYTES {
            let mut other = marks;
            other[at] ^= 0x10;
            assert!(!is_good(&other), "byte {at}");
        }
        marks[MARK_BYTES..].copy_from_slice(&ERASING);
        assert!(!is_good(&marks));
    }
}
