//! The chip's flash, for the settings.
//!
//! The F4 and the H7 have two banks: the program runs on from the first while the second is written or erased. The F7 has one bank
//! by default: the chip stalls for up to 2 s per erase (about every 60th `save`, see `mobgate-flash`). DMA and Ethernet keep
//! receiving meanwhile.

use embassy_stm32::flash::{Error, Flash, MAX_ERASE_SIZE, WRITE_SIZE};
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use mobgate_flash::{TEXT_BYTES_MAX, text_bytes_max};

/// Flash driver mode: interrupt-driven where possible, see above.
#[cfg(feature = "f7")]
pub(crate) type Mode = embassy_stm32::flash::Blocking;
/// Flash driver mode: interrupt-driven where possible, see above.
#[cfg(not(feature = "f7"))]
pub(crate) type Mode = embassy_stm32::flash::Async;

/// Offset of the settings in the flash: the last two sectors of 2 MiB. Each board's `regions.x` keeps the program out of them.
pub(crate) const SETTINGS_START: u32 = 2 * 1024 * 1024 - 2 * MAX_ERASE_SIZE as u32;

const _: () = assert!(text_bytes_max::<SettingsFlash>() == TEXT_BYTES_MAX, "the longest settings fit");

/// The flash for the settings' store.
pub(crate) struct SettingsFlash(Flash<'static, Mode>);

impl SettingsFlash {
    /// All of the chip's flash; the store uses only its two sectors.
    pub(crate) fn new(flash: Flash<'static, Mode>) -> Self {
        Self(flash)
    }
}

impl ErrorType for SettingsFlash {
    type Error = Error;
}

impl ReadNorFlash for SettingsFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        // On the H7, a flash word left partially written by a power cut needs special handling.
        #[cfg(feature = "h7")]
        return mobgate_stm32_boot::flash::half_written::read(offset, bytes);
        #[cfg(not(feature = "h7"))]
        return self.0.blocking_read(offset, bytes);
    }

    fn capacity(&self) -> usize {
        embassy_stm32::flash::FLASH_SIZE
    }
}

impl NorFlash for SettingsFlash {
    const WRITE_SIZE: usize = WRITE_SIZE;
    // The last sectors are the chip's largest.
    const ERASE_SIZE: usize = MAX_ERASE_SIZE;

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        // One bank, see above.
        #[cfg(feature = "f7")]
        return self.0.blocking_write(offset, bytes);
        #[cfg(feature = "h7")]
        mobgate_stm32_boot::flash::forget_errors();
        #[cfg(not(feature = "f7"))]
        return self.0.write(offset, bytes).await;
    }

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        // One bank, see above: nothing else can feed the watchdog meanwhile, and the first start erases several sectors in a row.
        #[cfg(feature = "f7")]
        return (from..to).step_by(Self::ERASE_SIZE).try_for_each(|sector| {
            crate::registers::feed_watchdog();
            self.0.blocking_erase(sector, sector + Self::ERASE_SIZE as u32)
        });
        #[cfg(feature = "h7")]
        mobgate_stm32_boot::flash::forget_errors();
        #[cfg(not(feature = "f7"))]
        return self.0.erase(from, to).await;
    }
}
