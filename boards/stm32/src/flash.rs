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
        return half_written::read(offset, bytes);
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
        crate::registers::forget_flash_errors();
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
        crate::registers::forget_flash_errors();
        #[cfg(not(feature = "f7"))]
        return self.0.erase(from, to).await;
    }
}

/// Reads that may fail error correction.
#[cfg(feature = "h7")]
mod half_written {
    use core::arch::asm;
    use core::ptr::read_volatile;

    use cortex_m::asm::dsb;
    use embassy_stm32::flash::{Error, FLASH_BASE, FLASH_SIZE, WRITE_SIZE};
    use embassy_stm32::pac;

    const WORDS: usize = WRITE_SIZE / size_of::<u32>();
    /// CCR.BFHFNMIGN: ignore data bus faults at priority -1 (ARMv7-M architecture, B3.2.8).
    const IGNORE_BUS_FAULTS: u32 = 1 << 8;

    /// Reads words that fail error correction as zeros (RM0433, 4.3.9): on a flash word left partially written by a power cut the
    /// H7 raises a bus fault, which would end every start when the settings are read.
    pub(super) fn read(offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        let end = offset as usize + bytes.len();
        if end > FLASH_SIZE {
            return Err(Error::Size);
        }
        let mut at = offset as usize;
        let mut rest = bytes;
        while !rest.is_empty() {
            let within = at % WRITE_SIZE;
            let count = rest.len().min(WRITE_SIZE - within);
            let word = flash_word(FLASH_BASE + at - within);
            let (now, later) = rest.split_at_mut(count);
            now.iter_mut().zip(&word[within..]).for_each(|(to, &from)| *to = from);
            (at, rest) = (at + count, later);
        }
        Ok(())
    }

    fn flash_word(address: usize) -> [u8; WRITE_SIZE] {
        let mut bytes = [0; WRITE_SIZE];
        // SAFETY: the address is within the chip's flash, as checked by the caller. Priority -1 lasts for eight reads; no interrupt
        // can occur meanwhile, so no other code runs with faults ignored.
        let failed = unsafe {
            let control = &(*cortex_m::peripheral::SCB::PTR).ccr;
            asm!("cpsid f");
            control.modify(|value| value | IGNORE_BUS_FAULTS);
            dsb();
            for nth in 0..WORDS {
                let word = read_volatile((address as *const u32).add(nth));
                bytes[nth * 4..][..4].copy_from_slice(&word.to_le_bytes());
            }
            dsb();
            control.modify(|value| value & !IGNORE_BUS_FAULTS);
            asm!("cpsie f");
            clear_failure()
        };
        if failed { [0; WRITE_SIZE] } else { bytes }
    }

    /// Whether either bank has detected a double-bit error; clears it.
    fn clear_failure() -> bool {
        (0..2).fold(false, |failed, bank| {
            let bank = pac::FLASH.bank(bank);
            let here = bank.sr().read().dbeccerr();
            bank.ccr().write(|clear| {
                clear.set_clr_dbeccerr(true);
                clear.set_clr_sneccerr(true);
            });
            failed || here
        })
    }
}
