//! The board's flash, for the settings. The program runs from it, so it stands still while the flash is written or erased: 45 ms for
//! each of the 32 sectors of 4 KiB that the store erases as one (400 ms at worst). Tasks run in between; DMA and the PIOs go on.

use embassy_futures::yield_now;
use embassy_rp::flash::{Blocking, ERASE_SIZE, Error, Flash};
use embassy_rp::peripherals::FLASH;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use mobgate_flash::{TEXT_BYTES_MAX, text_bytes_max};

/// Bytes of the flash: 16 Mbit, as on a Pico and a W5500-EVB-Pico.
pub(crate) const FLASH_BYTES: usize = 2 * 1024 * 1024;
/// What the store takes as a sector: two copies of the longest settings.
const SECTOR_BYTES: usize = 128 * 1024;
/// Offset of the settings: the end of the flash. `regions.x` keeps the program out of them.
pub(crate) const SETTINGS_START: u32 = (FLASH_BYTES - 2 * SECTOR_BYTES) as u32;

const _: () = assert!(text_bytes_max::<SettingsFlash>() == TEXT_BYTES_MAX, "the longest settings fit");

/// The flash's driver.
pub(crate) type BoardFlash = Flash<'static, FLASH, Blocking, FLASH_BYTES>;

/// The flash for the settings' store.
pub(crate) struct SettingsFlash(pub(crate) BoardFlash);

impl ErrorType for SettingsFlash {
    type Error = Error;
}

impl ReadNorFlash for SettingsFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.blocking_read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        FLASH_BYTES
    }
}

impl NorFlash for SettingsFlash {
    const WRITE_SIZE: usize = embassy_rp::flash::WRITE_SIZE;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        self.0.blocking_write(offset, bytes)
    }

    /// The first sector, with the store's marks, goes first: what a power cut leaves is erased again.
    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        for sector in (from..to).step_by(ERASE_SIZE) {
            self.0.blocking_erase(sector, sector + ERASE_SIZE as u32)?;
            yield_now().await;
        }
        Ok(())
    }
}
