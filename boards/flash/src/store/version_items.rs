//! The list of the versions in the store: one item, which is written before the head.
//!
//! What is overwritten stays in the list until the next save, and other firmware does not know it. So the start looks which texts are
//! whole. It reads all items once, in the order in which they were written: to fetch each piece would be to look for it through all
//! of them.

use embedded_storage_async::nor_flash::NorFlash;
use heapless::Vec;
use mobgate::hal::StoreError;

use super::items::{HEAD_KEY, PIECE_BYTES, reason};
use super::ring::{HALF_BIT, Ring, VERSIONS_MAX, pieces};
use super::versions::{Record, Told};
use super::{FlashStore, versions};
use crate::head::{CRC, Head};

const VERSIONS_KEY: u16 = HEAD_KEY - 3;

impl<F: NorFlash> FlashStore<F> {
    /// Finds the versions whose text is whole. What cannot be read is none.
    pub(super) async fn find_versions(&mut self) {
        self.versions.records = self.find_records().await.unwrap_or_default();
        self.versions.go_back::<F>(self.valid().ok().flatten());
    }

    async fn find_records(&mut self) -> Result<Vec<Record, VERSIONS_MAX>, StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let found = map.fetch_item::<&[u8]>(&mut self.buffer, &VERSIONS_KEY).await.map_err(reason)?;
        let (listed, _) = found.unwrap_or_default().as_chunks();
        let mut records: Vec<Record, VERSIONS_MAX> = listed.iter().copied().take(VERSIONS_MAX).collect();
        if !records.is_empty() {
            self.sum_pieces().await?;
        }
        records.retain(|record| versions::head(record).is_some_and(|head| self.is_whole(head)));
        Ok(records)
    }

    /// Puts the check sum of each place's piece where a save has its last piece.
    async fn sum_pieces(&mut self) -> Result<(), StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let mut items = map.fetch_all_items(&mut self.buffer).await.map_err(reason)?;
        while let Some((key, piece)) = items.next::<&[u8]>(&mut self.buffer).await.map_err(reason)? {
            let (sums, _) = self.piece.as_chunks_mut();
            let (half, number) = (usize::from(key / HALF_BIT), usize::from(key % HALF_BIT));
            let is_piece = half <= 1 && number < Ring::<F>::HALF;
            if let Some(sum) = sums.get_mut(half * Ring::<F>::HALF + number).filter(|_| is_piece) {
                *sum = CRC.checksum(piece).to_le_bytes();
            }
        }
        Ok(())
    }

    /// Whether the pieces' check sums together are that of the text.
    fn is_whole(&self, head: Head) -> bool {
        let (sums, _) = self.piece.as_chunks();
        let (mut left, mut crc) = (head.length as usize, 0);
        for nth in 0..pieces(head).min(Ring::<F>::PLACES) {
            let bytes = left.min(PIECE_BYTES);
            left -= bytes;
            let sum = sums.get(Ring::<F>::place(head, nth)).copied().unwrap_or_default();
            crc = crc_of_both(crc, (u32::from_le_bytes(sum), bytes));
        }
        left == 0 && crc == head.crc
    }

    /// Notes who has written the text of `head`.
    pub(super) async fn note_version(&mut self, head: Head) -> Result<(), StoreError> {
        let signature = core::mem::take(&mut self.versions.signed);
        self.versions.add::<F>(head, &signature);
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

/// The CRC of a text, by those of its two parts; the second one has so many bytes.
fn crc_of_both(first: u32, (second, bytes): (u32, usize)) -> u32 {
    // Without what they begin and end with, CRCs add up: as if the second part were zeros, and it behind a first part of zeros.
    let mut zeros = CRC.digest_with_initial(first.reverse_bits());
    (0..bytes).for_each(|_| zeros.update(&[0]));
    !zeros.finalize() ^ second
}
