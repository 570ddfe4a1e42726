//! The list of the versions in the store: one item, which is written before the head, and before a piece of a version is overwritten.
//!
//! Other firmware does not know it, and may have overwritten a text that is in the list: so a version is checked when it is read.

use embedded_storage_async::nor_flash::NorFlash;
use heapless::Vec;
use mobgate::hal::StoreError;

use super::items::{HEAD_KEY, reason};
use super::ring::VERSIONS_MAX;
use super::versions::{Record, Told};
use super::{FlashStore, versions};
use crate::head::Head;

const VERSIONS_KEY: u16 = HEAD_KEY - 3;

impl<F: NorFlash> FlashStore<F> {
    /// Finds the versions. A list that cannot be read is empty.
    pub(super) async fn find_versions(&mut self) {
        self.versions.records = self.find_records().await.unwrap_or_default();
        self.versions.go_back::<F>(self.valid().ok().flatten());
    }

    async fn find_records(&mut self) -> Result<Vec<Record, VERSIONS_MAX>, StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let found = map.fetch_item::<&[u8]>(&mut self.buffer, &VERSIONS_KEY).await.map_err(reason)?;
        let (listed, _) = found.unwrap_or_default().as_chunks();
        let known = listed.iter().copied().filter(|record| versions::head(record).is_some());
        Ok(known.take(VERSIONS_MAX).collect())
    }

    /// Notes who has written the text of `head`.
    pub(super) async fn note_version(&mut self, head: Head) -> Result<(), StoreError> {
        let signature = core::mem::take(&mut self.versions.signed);
        self.versions.add::<F>(head, &signature);
        self.put_versions().await
    }

    /// Takes the version out of the list that has a piece in `place`, before that is overwritten.
    pub(super) async fn give_up_version(&mut self, place: usize) -> Result<(), StoreError> {
        if self.versions.give_up::<F>(place) { self.put_versions().await } else { Ok(()) }
    }

    async fn put_versions(&mut self) -> Result<(), StoreError> {
        let list = self.versions.records.as_flattened();
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        map.store_item(&mut self.buffer, &VERSIONS_KEY, &list).await.map_err(reason)
    }

    /// The version `nth`: 0 is the valid text, 1 the one before.
    pub(super) fn version(&self, nth: usize) -> Option<(Head, Told<'_>)> {
        self.valid().ok()?;
        self.versions.get(nth)
    }
}
