//! New firmware that waits for a restart, as the console shows it.

use mobgate::hal::{FirmwareState, System, Update, UpdateError, Version};

use crate::system::Board;

/// An updater; `board` shows what it has finished. An EtherCAT MainDevice decides when that starts: when it takes the SubDevice out of Boot.
pub(crate) struct Shown<'b, U> {
    update: U,
    board: &'b Board,
}

impl<'b, U> Shown<'b, U> {
    pub(crate) const fn new(update: U, board: &'b Board) -> Self {
        Self { update, board }
    }
}

impl<U: Update> Update for Shown<'_, U> {
    const EXISTS: bool = U::EXISTS;

    async fn begin(&mut self, bytes: Option<u32>, allow_older: bool) -> Result<(), UpdateError> {
        self.update.begin(bytes, allow_older).await?;
        // What has waited is overwritten.
        if let Some(FirmwareState::Next(_)) = self.board.firmware() {
            self.board.set_firmware(FirmwareState::Confirmed);
        }
        Ok(())
    }

    async fn write(&mut self, bytes: &[u8]) -> Result<(), UpdateError> {
        self.update.write(bytes).await
    }

    async fn finish(&mut self) -> Result<Version, UpdateError> {
        let version = self.update.finish().await?;
        self.board.set_firmware(FirmwareState::Next(version.clone()));
        Ok(version)
    }

    fn discard(&mut self) {
        self.update.discard();
    }
}
