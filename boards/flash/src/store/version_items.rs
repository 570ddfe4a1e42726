//! The items of the versions in the store: one for each copy, which is written before the head.
//!
//! A save overwrites the older copy, which its check sum then shows: of its version nothing is left.

use embedded_storage_async::nor_flash::NorFlash;
use heapless::Vec;
use mobgate::hal::StoreError;

use super::versions::{VERSION_BYTES_MAX, Who};
use super::{FlashStore, HEAD_KEY, reason};
use crate::head::{HEAD_BYTES, Head};

/// The key of the first copy's item; that of the other one is the next lower one.
const VERSION_KEY: u16 = HEAD_KEY - 3;

fn key(copy: u8) -> u16 {
    VERSION_KEY - u16::from(copy)
}

fn parse(item: &[u8]) -> Option<(Head, Who)> {
    let (head, who) = item.split_at_checked(HEAD_BYTES)?;
    let who = core::str::from_utf8(who).ok()?;
    Some((Head::from_bytes(head)?, Who::try_from(who).ok()?))
}

impl<F: NorFlash> FlashStore<F> {
    /// Finds the versions whose text is whole. What cannot be read is none.
    pub(super) async fn find_versions(&mut self) {
        for copy in 0..=1 {
            let found = self.find_version(copy).await.ok().flatten();
            self.versions.set(copy, found);
        }
    }

    async fn find_version(&mut self, copy: u8) -> Result<Option<(Head, Who)>, StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let found = map.fetch_item::<&[u8]>(&mut self.buffer, &key(copy)).await.map_err(reason)?;
        let Some((head, who)) = found.and_then(parse).filter(|(head, _)| head.copy == copy) else {
            return Ok(None);
        };
        self.check(&head).await?;
        Ok(Some((head, who)))
    }

    /// Notes who has written the copy of `head`.
    pub(super) async fn note_version(&mut self, head: Head) -> Result<(), StoreError> {
        let who = core::mem::take(&mut self.versions.signed);
        let mut item = Vec::<u8, VERSION_BYTES_MAX>::new();
        // Sized for both.
        let _ =
            item.extend_from_slice(&head.to_bytes()).and_then(|()| item.extend_from_slice(who.as_bytes()));
        self.put(key(head.copy), &item).await?;
        self.versions.set(head.copy, Some((head, who)));
        Ok(())
    }

    /// The version `nth`: 0 is the valid text, 1 the one before.
    pub(super) fn version(&self, nth: usize) -> Option<(Head, &Who)> {
        let valid = self.valid().ok()??;
        let copy = match nth {
            0 => valid.copy,
            1 => 1 - valid.copy,
            _ => return None,
        };
        let (head, who) = self.versions.copies.get(usize::from(copy))?.as_ref()?;
        Some((*head, who))
    }
}
