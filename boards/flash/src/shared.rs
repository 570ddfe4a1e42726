//! One store for several consoles: a save locks it until it ends.

use core::fmt;

use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_sync::mutex::{Mutex, MutexGuard};
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::{Store, StoreError};

use crate::store::{FlashStore, SECRET_BYTES, Signature};

/// A console's handle of the store. Dropping it during a save discards the unfinished version.
pub struct SharedStore<'a, M: RawMutex, F: NorFlash> {
    store: &'a Mutex<M, FlashStore<F>>,
    /// Held from the first append to the commit.
    saving: Option<MutexGuard<'a, M, FlashStore<F>>>,
    /// Whose the next version is.
    signed: Signature,
}

impl<'a, M: RawMutex, F: NorFlash> SharedStore<'a, M, F> {
    /// Creates a handle of `store`.
    pub const fn new(store: &'a Mutex<M, FlashStore<F>>) -> Self {
        Self { store, saving: None, signed: Signature::new() }
    }

    /// Another handle of the same store.
    #[must_use]
    pub const fn another(&self) -> Self {
        Self::new(self.store)
    }

    /// As [`FlashStore::secret`].
    ///
    /// # Errors
    /// Likewise.
    pub async fn secret(
        &mut self,
        make: impl FnOnce(&mut [u8; SECRET_BYTES]) -> bool,
    ) -> Result<[u8; SECRET_BYTES], StoreError> {
        self.store.lock().await.secret(make).await
    }

    /// Locks the store, and discards what another handle left unfinished.
    async fn alone(&mut self) -> MutexGuard<'a, M, FlashStore<F>> {
        match self.saving.take() {
            Some(guard) => guard,
            None => {
                let mut guard = self.store.lock().await;
                guard.forget();
                guard
            }
        }
    }
}

impl<M: RawMutex, F: NorFlash> Store for SharedStore<'_, M, F> {
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        let mut alone;
        let store = match &mut self.saving {
            Some(store) => store,
            None => {
                alone = self.store.lock().await;
                &mut alone
            }
        };
        // In one place: how to read is long.
        store.read(offset, into).await
    }

    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError> {
        let mut store = self.alone().await;
        store.append(text).await?;
        self.saving = Some(store);
        Ok(())
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        let mut store = self.alone().await;
        store.signed(core::mem::take(&mut self.signed));
        store.commit().await
    }

    fn sign(&mut self, who: &dyn fmt::Display, when: impl FnOnce() -> Option<u64>) {
        self.signed = Signature::of(who, when);
    }

    /// While somebody saves there is none.
    fn write_version(&mut self, nth: usize, out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        match &mut self.saving {
            Some(store) => store.write_version(nth, out),
            None => self.store.try_lock().ok()?.write_version(nth, out),
        }
    }

    async fn read_version(
        &mut self,
        nth: usize,
        offset: usize,
        into: &mut [u8],
    ) -> Result<usize, StoreError> {
        self.alone().await.read_version(nth, offset, into).await
    }
}
