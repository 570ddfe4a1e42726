//! The board's flash, for the settings. The program runs from it, so it stands still while the flash is written or erased: 45 ms for
//! each of the 32 sectors of 4 KiB that the store erases as one (400 ms at worst). Tasks run in between; DMA and the PIOs go on.

use embassy_futures::yield_now;
use embassy_rp::flash::Error;
use embedded_storage::nor_flash::{NorFlash as _, ReadNorFlash as _};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use mobgate_flash::{TEXT_BYTES_MAX, text_bytes_max};
use mobgate_rp_boot::flash::{Chip, FLASH_BYTES};

/// What the store takes as a sector: two copies of the longest settings.
const SECTOR_BYTES: usize = 128 * 1024;
/// Offset of the settings: the end of the flash. `regions.x` keeps the program out of them.
pub(crate) const SETTINGS_START: u32 = (FLASH_BYTES - 2 * SECTOR_BYTES) as u32;

const _: () = assert!(text_bytes_max::<SettingsFlash>() == TEXT_BYTES_MAX, "the longest settings fit");

/// The flash for the settings' store.
pub(crate) struct SettingsFlash(pub(crate) Chip);

impl ErrorType for SettingsFlash {
    type Error = Error;
}

impl ReadNorFlash for SettingsFlash {
    const READ_SIZE: usize = Chip::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        FLASH_BYTES
    }
}

impl NorFlash for SettingsFlash {
    const WRITE_SIZE: usize = Chip::WRITE_SIZE;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        self.0.write(offset, bytes)
    }

    /// The first sector, with the store's marks, goes first: what a power cut leaves is erased again.
    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        for sector in (from..to).step_by(Chip::ERASE_SIZE) {
            self.0.erase(sector, sector + Chip::ERASE_SIZE as u32)?;
            yield_now().await;
        }
        Ok(())
    }
}
