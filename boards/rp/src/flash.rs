//! The board's flash, for the settings and for new firmware. The program runs from it, so it stands still while the flash is written or
//! erased: 45 ms for each sector of 4 KiB (400 ms at worst), of which a page of an update has eight, and one of the settings 32. Tasks run
//! in between; DMA and the PIOs go on.

use embassy_futures::yield_now;
use embassy_rp::flash::Error;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage::nor_flash::{NorFlash as _, ReadNorFlash as _};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use mobgate_flash::{TEXT_BYTES_MAX, text_bytes_max};
use mobgate_image::{Info, PUBLIC_KEY};
use mobgate_rp_boot::flash::{Chip, FLASH_BYTES, PAGE_BYTES, STATE_PAGE_BYTES, layout};
use mobgate_update::{Partition, Trust, Updater};

/// What the store takes as a sector: two copies of the longest settings.
const SECTOR_BYTES: usize = 128 * 1024;
/// The flash, which settings and updates share.
pub(crate) type SharedFlash = Mutex<NoopRawMutex, ChipFlash>;
/// The settings' two pages.
type Settings<'a> = Partition<'a, NoopRawMutex, ChipFlash, SECTOR_BYTES>;

const _: () = assert!(text_bytes_max::<Settings<'_>>() == TEXT_BYTES_MAX, "the longest settings fit");

/// The part of the settings: the end of the flash. `regions.x` keeps the program out of it.
pub(crate) fn settings(flash: &SharedFlash) -> Settings<'_> {
    Partition::new(flash, (FLASH_BYTES - 2 * SECTOR_BYTES) as u32..FLASH_BYTES as u32)
}

/// Takes new firmware, while `running` runs.
pub(crate) fn updater(
    flash: &SharedFlash,
    running: Info,
) -> Updater<'_, NoopRawMutex, ChipFlash, PAGE_BYTES, STATE_PAGE_BYTES> {
    Updater::new(flash, layout(), Trust { running, key: PUBLIC_KEY })
}

/// All of the flash, for tasks.
pub(crate) struct ChipFlash(pub(crate) Chip);

impl ErrorType for ChipFlash {
    type Error = Error;
}

impl ReadNorFlash for ChipFlash {
    const READ_SIZE: usize = Chip::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        FLASH_BYTES
    }
}

impl NorFlash for ChipFlash {
    const WRITE_SIZE: usize = Chip::WRITE_SIZE;
    const ERASE_SIZE: usize = Chip::ERASE_SIZE;

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        self.0.write(offset, bytes)
    }

    /// The first sector, with the marks of the settings' store, goes first: what a power cut leaves is erased again.
    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        for sector in (from..to).step_by(Chip::ERASE_SIZE) {
            self.0.erase(sector, sector + Chip::ERASE_SIZE as u32)?;
            yield_now().await;
        }
        Ok(())
    }
}
