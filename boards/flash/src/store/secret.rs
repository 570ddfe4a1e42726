//! A secret of the board's own beside the settings, which neither a save nor a factory reset changes.

use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::StoreError;

use super::FlashStore;
use super::items::{HEAD_KEY, SECRET_BYTES, reason};

const SECRET_KEY: u16 = HEAD_KEY - 2;

impl<F: NorFlash> FlashStore<F> {
    /// The secret; what `make` fills in is kept as one if there is none yet. It is lost with settings that are corrupt.
    ///
    /// # Errors
    /// If the flash fails, or `make` says that it cannot.
    pub async fn secret(
        &mut self,
        make: impl FnOnce(&mut [u8; SECRET_BYTES]) -> bool,
    ) -> Result<[u8; SECRET_BYTES], StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let found = map.fetch_item::<&[u8]>(&mut self.buffer, &SECRET_KEY).await.map_err(reason)?;
        if let Some(secret) = found.and_then(|bytes| bytes.try_into().ok()) {
            return Ok(secret);
        }
        let mut secret = [0; SECRET_BYTES];
        if !make(&mut secret) {
            return Err(StoreError::Refused("there are no random numbers"));
        }
        self.put(SECRET_KEY, &secret).await?;
        Ok(secret)
    }
}
