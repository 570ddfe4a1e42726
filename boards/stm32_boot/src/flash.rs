//! The chip's flash: its partitions, and how it is read where a power cut has left a word half written.

use embassy_stm32::flash::{Blocking, Error, FLASH_BASE, FLASH_SIZE, Flash, MAX_ERASE_SIZE, WRITE_SIZE};
use embassy_stm32::peripherals::FLASH;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use mobgate_boot::Layout;

/// Bytes of a page of the images' partitions: the chip's largest sectors.
pub const PAGE_BYTES: usize = MAX_ERASE_SIZE;
/// Bytes of the state's page: a sector of the chip's smallest on the F4 and the F7; those of the H7 are alike.
pub const STATE_PAGE_BYTES: usize = if cfg!(feature = "f4") {
    16 * 1024
} else if cfg!(feature = "f7") {
    32 * 1024
} else {
    MAX_ERASE_SIZE
};

/// The partitions, as the board's `regions.x` has them.
pub fn layout() -> Layout {
    mobgate_boot_cortex_m::layout(FLASH_BASE)
}

/// F4 chips before revision 3 misread bank 2 unless PA12 is held low (errata 2.2.11): drives it.
pub(crate) fn hold_second_bank() {
    #[cfg(feature = "f4")]
    {
        use embassy_stm32::pac::gpio::vals::{Moder, Pupdr};
        use embassy_stm32::pac::{GPIOA, RCC};
        const PIN: usize = 12;
        RCC.ahb1enr().modify(|enabled| enabled.set_gpioaen(true));
        // Two cycles pass until it has its clock (errata 2.1.6).
        RCC.ahb1enr().read();
        GPIOA.pupdr().modify(|pulls| pulls.set_pupdr(PIN, Pupdr::PULL_DOWN));
        GPIOA.moder().modify(|modes| modes.set_moder(PIN, Moder::OUTPUT));
    }
}

/// All of the chip's flash, without interrupts.
pub(crate) struct Chip(Flash<'static, Blocking>);

impl Chip {
    pub(crate) fn new() -> Self {
        // SAFETY: the boot loader makes it once, and uses no other driver.
        Self(Flash::new_blocking(unsafe { FLASH::steal() }))
    }
}

impl ErrorType for Chip {
    type Error = Error;
}

impl ReadNorFlash for Chip {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        // See `half_written`.
        #[cfg(feature = "h7")]
        return half_written::read(offset, bytes);
        #[cfg(not(feature = "h7"))]
        return self.0.blocking_read(offset, bytes);
    }

    fn capacity(&self) -> usize {
        FLASH_SIZE
    }
}

impl NorFlash for Chip {
    const WRITE_SIZE: usize = WRITE_SIZE;
    // The smallest that the partitions are erased in.
    const ERASE_SIZE: usize = STATE_PAGE_BYTES;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        // See there.
        #[cfg(feature = "h7")]
        forget_errors();
        self.0.blocking_write(offset, bytes)
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        // See there.
        #[cfg(feature = "h7")]
        forget_errors();
        self.0.blocking_erase(from, to)
    }
}

/// Clears the flash's error flags: embassy-stm32 writes the status register, which does not clear them on the H7, and would refuse
/// every operation after an error until the next reset.
#[cfg(feature = "h7")]
pub fn forget_errors() {
    for bank in [0, 1].map(|bank| embassy_stm32::pac::FLASH.bank(bank)) {
        bank.ccr().write(|clear| {
            clear.set_clr_wrperr(true);
            clear.set_clr_pgserr(true);
            clear.set_clr_strberr(true);
            clear.set_clr_incerr(true);
            clear.set_clr_operr(true);
            clear.set_clr_rdperr(true);
            clear.set_clr_rdserr(true);
            clear.set_clr_sneccerr(true);
            clear.set_clr_dbeccerr(true);
            clear.set_clr_crcrderr(true);
        });
    }
}

/// Reads that may fail error correction.
#[cfg(feature = "h7")]
pub mod half_written {
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
    pub fn read(offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
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
