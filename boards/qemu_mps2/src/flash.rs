//! Two flash sectors in a file on the host, so that saved settings outlive the emulator.

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

use crate::semihosting::{CommandLine, File, HostError};

/// Sector and flash word sizes of an STM32H7.
const SECTOR_BYTES: usize = 128 * 1024;
const WORD_BYTES: usize = 32;
/// Bytes erased by one call to the host.
const ERASE_STEP_BYTES: usize = 1024;
const SECTORS: usize = 2;

pub(crate) struct FileFlash(File);

impl FileFlash {
    /// Opens the flash in the file named on the command line.
    pub(crate) fn open() -> Result<Self, HostError> {
        let mut flash = Self(File::open(CommandLine::read().flash().ok_or(HostError)?)?);
        if flash.0.length() < SECTORS * SECTOR_BYTES {
            // A new file: blank, as from the factory.
            flash.fill(0, (SECTORS * SECTOR_BYTES) as u32)?;
        }
        Ok(flash)
    }

    fn fill(&mut self, from: u32, to: u32) -> Result<(), HostError> {
        let mut steps = (from..to).step_by(ERASE_STEP_BYTES);
        steps.try_for_each(|offset| self.0.write(offset, &[0xff; ERASE_STEP_BYTES]))
    }
}

impl NorFlashError for HostError {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::Other
    }
}

impl ErrorType for FileFlash {
    type Error = HostError;
}

impl ReadNorFlash for FileFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), HostError> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        SECTORS * SECTOR_BYTES
    }
}

impl NorFlash for FileFlash {
    const WRITE_SIZE: usize = WORD_BYTES;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), HostError> {
        self.fill(from, to)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), HostError> {
        self.0.write(offset, bytes)
    }
}
