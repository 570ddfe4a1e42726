//! The chip's flash, for the settings and for new firmware.
//!
//! The F4 and the H7 have two banks: the program runs on from the first while the second is written or erased. The F7 has one bank
//! by default: the chip stalls for up to 2 s per erase (about every 60th `save`, see `mobgate-flash`, and each page of an update). DMA
//! and Ethernet keep receiving meanwhile.

use embassy_stm32::flash::{Error, Flash, WRITE_SIZE};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use mobgate_flash::{TEXT_BYTES_MAX, text_bytes_max};
use mobgate_image::{Info, PUBLIC_KEY};
use mobgate_stm32_boot::flash::{PAGE_BYTES, STATE_PAGE_BYTES, layout};
use mobgate_update::{Partition, Trust, Updater};

/// Flash driver mode: interrupt-driven where possible, see above.
#[cfg(feature = "f7")]
pub(crate) type Mode = embassy_stm32::flash::Blocking;
/// Flash driver mode: interrupt-driven where possible, see above.
#[cfg(not(feature = "f7"))]
pub(crate) type Mode = embassy_stm32::flash::Async;

/// The flash, which settings and updates share.
pub(crate) type SharedFlash = Mutex<NoopRawMutex, ChipFlash>;
/// The settings' two pages.
type Settings<'a> = Partition<'a, NoopRawMutex, ChipFlash, PAGE_BYTES>;

/// End of the settings in the flash, and of the flash: 2 MiB. Each board's `regions.x` keeps the program out of them.
const SETTINGS_END: u32 = 2 * 1024 * 1024;

const _: () = assert!(text_bytes_max::<Settings<'_>>() == TEXT_BYTES_MAX, "the longest settings fit");

/// The part of the settings.
pub(crate) fn settings(flash: &SharedFlash) -> Settings<'_> {
    Partition::new(flash, SETTINGS_END - 2 * PAGE_BYTES as u32..SETTINGS_END)
}

/// Takes new firmware, while `running` runs.
pub(crate) fn updater(
    flash: &SharedFlash,
    running: Info,
) -> Updater<'_, NoopRawMutex, ChipFlash, PAGE_BYTES, STATE_PAGE_BYTES> {
    Updater::new(flash, layout(), Trust { running, key: PUBLIC_KEY })
}

pub(crate) struct ChipFlash(Flash<'static, Mode>);

impl ChipFlash {
    pub(crate) fn new(flash: Flash<'static, Mode>) -> Self {
        Self(flash)
    }
}

impl ErrorType for ChipFlash {
    type Error = Error;
}

impl ReadNorFlash for ChipFlash {
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

impl NorFlash for ChipFlash {
    const WRITE_SIZE: usize = WRITE_SIZE;
    // The smallest of the partitions' pages.
    const ERASE_SIZE: usize = STATE_PAGE_BYTES;

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
        // One bank, see above: nothing else can feed the watchdog meanwhile. Partitions erase one page at a time.
        #[cfg(feature = "f7")]
        mobgate_stm32_boot::watchdog::feed();
        #[cfg(feature = "f7")]
        return self.0.blocking_erase(from, to);
        #[cfg(feature = "h7")]
        mobgate_stm32_boot::flash::forget_errors();
        #[cfg(not(feature = "f7"))]
        return self.0.erase(from, to).await;
    }
}
