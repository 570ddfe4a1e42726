//! [`FlashStore`]: texts as pieces in a ring, whose items are in a map, and a head that says which one is valid.
//!
//! While an image is on trial, the head stays as it is: what is saved goes behind its text, with a head of its own that names the
//! image. Confirming makes that the head. If another image runs at the next start, that one went back, and its head is dropped.

use core::fmt;

use crc::{Digest, NoTable};
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::{Store, StoreError};

use crate::head::{CRC, Head, trial_from_bytes, trial_to_bytes};
use crate::sectors::Sectors;

// Images without it are smaller: nobody asks for a version there.
#[cfg_attr(not(feature = "versions"), path = "store/no_version_items.rs")]
mod version_items;
#[cfg_attr(not(feature = "versions"), path = "store/no_versions.rs")]
mod versions;

mod items;
mod ring;
mod secret;

use self::items::{HEAD_KEY, KEY_BYTES, Map, PIECE_BYTES, TRIAL_KEY, map, reason};
pub use self::items::{SECRET_BYTES, TEXT_BYTES_MAX};
pub use self::ring::text_bytes_max;
use self::ring::{Ring, pieces};
pub(crate) use self::versions::Signature;
use self::versions::Versions;

/// The image that runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Image {
    /// A number that the image before it does not have.
    pub id: u32,
    /// False while it is on trial.
    pub confirmed: bool,
}

impl Image {
    /// On a board without updates.
    pub const ONLY: Self = Self { id: 0, confirmed: true };
}

/// Stores the settings in two sectors of `F`.
pub struct FlashStore<F: NorFlash> {
    /// `None` only while it is rebuilt.
    map: Option<Map<F>>,
    image: Image,
    /// The valid text, or why nothing can be read.
    head: Result<Option<Head>, StoreError>,
    /// The text saved by the image on trial, which is valid until the image goes back.
    trial: Option<Head>,
    /// Whether the flash has a trial's head.
    has_trial: bool,
    /// Scratch buffer of the map for one item.
    buffer: [u8; KEY_BYTES + PIECE_BYTES],
    /// The text being written.
    next: Option<Next>,
    /// Its last, incomplete piece.
    piece: [u8; PIECE_BYTES],
    /// Texts to go back to.
    versions: Versions,
}

/// A text being written.
struct Next {
    /// Its place; its length and check sum are not known yet.
    head: Head,
    length: usize,
    digest: Digest<'static, u32, NoTable>,
}

impl<F: NorFlash> FlashStore<F> {
    /// Opens the store in the two sectors at `start` of `flash`, and completes what a power cut interrupted. If the flash fails,
    /// nothing is read or written until the next start.
    pub async fn open(flash: F, start: u32, image: Image) -> Self {
        let mut sectors = Sectors::new(flash, start);
        let prepared = sectors.prepare().await;
        let mut store = Self {
            map: Some(map(sectors)),
            image,
            head: Err(StoreError::Failed),
            trial: None,
            has_trial: false,
            buffer: [0; KEY_BYTES + PIECE_BYTES],
            next: None,
            piece: [0; PIECE_BYTES],
            versions: Versions::new(),
        };
        if prepared.is_ok() {
            store.find().await;
        }
        store
    }

    /// The image on trial is confirmed: what it has saved are the settings from now on.
    ///
    /// The image must be confirmed to the boot loader before, and no save may be in progress then: a caller locks the store, confirms,
    /// and calls this. A power cut between is harmless, because the next start finds a confirmed image and does the same.
    ///
    /// # Errors
    /// If the flash fails; the next start tries again.
    pub async fn confirm(&mut self) -> Result<(), StoreError> {
        self.image.confirmed = true;
        if let Some(head) = self.trial {
            self.put(HEAD_KEY, &head.to_bytes()).await?;
            (self.head, self.trial) = (Ok(Some(head)), None);
        }
        self.drop_trial().await
    }

    /// Finds the heads, and completes a confirmation, or the way back.
    async fn find(&mut self) {
        self.head = self.find_head().await;
        // A trial's head that cannot be read is none.
        self.trial = self.find_trial().await.unwrap_or_default();
        // What fails here is tried again before the next save, or at the next start.
        let _ = match self.trial {
            Some(_) if self.image.confirmed => self.confirm().await,
            Some(_) => Ok(()),
            None => self.drop_trial().await,
        };
        self.find_versions().await;
    }

    /// The head of this image's trial, if its text matches it. Once confirmed it is the same as the head, and is over.
    async fn find_trial(&mut self) -> Result<Option<Head>, StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let found = map.fetch_item::<&[u8]>(&mut self.buffer, &TRIAL_KEY).await.map_err(reason)?;
        let bytes = found.unwrap_or_default();
        self.has_trial = !bytes.is_empty();
        let Some((head, image)) = trial_from_bytes(bytes) else { return Ok(None) };
        if matches!(self.head, Ok(Some(valid)) if valid == head) || image != self.image.id {
            return Ok(None);
        }
        self.check(&head).await?;
        Ok(Some(head))
    }

    /// Drops the trial's head of the flash.
    async fn drop_trial(&mut self) -> Result<(), StoreError> {
        if self.has_trial {
            self.put(TRIAL_KEY, &[]).await?;
            self.has_trial = false;
        }
        Ok(())
    }

    /// Stores a head.
    async fn put(&mut self, key: u16, bytes: &[u8]) -> Result<(), StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        map.store_item(&mut self.buffer, &key, &bytes).await.map_err(reason)
    }

    /// Sets whose the next version is.
    pub(crate) fn signed(&mut self, signature: Signature) {
        self.versions.signed = signature;
    }

    /// Discards an uncommitted version.
    pub fn forget(&mut self) {
        self.next = None;
    }

    /// The head, if the text matches it.
    async fn find_head(&mut self) -> Result<Option<Head>, StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let found = map.fetch_item::<&[u8]>(&mut self.buffer, &HEAD_KEY).await.map_err(reason)?;
        let Some(bytes) = found else { return Ok(None) };
        let head = Head::from_bytes(bytes).ok_or(StoreError::Corrupt)?;
        self.check(&head).await?;
        Ok(Some(head))
    }

    /// Checks the pieces against the head.
    async fn check(&mut self, head: &Head) -> Result<(), StoreError> {
        let length = head.length as usize;
        let mut digest = CRC.digest();
        for nth in 0..pieces(*head) {
            let bytes = PIECE_BYTES.min(length - nth * PIECE_BYTES);
            digest.update(self.piece(*head, nth).await?.get(..bytes).ok_or(StoreError::Corrupt)?);
        }
        if digest.finalize() == head.crc { Ok(()) } else { Err(StoreError::Corrupt) }
    }

    /// A piece of a text. The last one may be longer than the rest of it.
    async fn piece(&mut self, head: Head, nth: usize) -> Result<&[u8], StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let found = map.fetch_item::<&[u8]>(&mut self.buffer, &Ring::<F>::key(head, nth)).await;
        found.map_err(reason)?.ok_or(StoreError::Corrupt)
    }

    /// The head of the text that is valid, if there is one.
    fn valid(&self) -> Result<Option<Head>, StoreError> {
        self.trial.map_or(self.head, |head| Ok(Some(head)))
    }

    /// Reads the text of a head from `offset` on.
    async fn read_text(&mut self, head: Head, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        let left = (head.length as usize).saturating_sub(offset);
        if left == 0 {
            return Ok(0);
        }
        let piece = self.piece(head, offset / PIECE_BYTES).await?;
        let there = piece.get(offset % PIECE_BYTES..).ok_or(StoreError::Corrupt)?;
        let count = there.len().min(left).min(into.len());
        into.iter_mut().zip(there).take(count).for_each(|(to, &from)| *to = from);
        Ok(count)
    }

    /// Starts a text beside the one that is valid.
    async fn begin(&mut self) -> Result<Next, StoreError> {
        if self.head == Err(StoreError::Corrupt) {
            // Nothing is readable, so nothing is lost, and corrupt items might be in the way.
            self.erase().await?;
            (self.head, self.has_trial) = (Ok(None), false);
            self.versions = Versions::new();
        }
        if self.image.confirmed {
            self.drop_trial().await?;
        }
        // Overwritten from here on. A power cut loses nothing by that: a restart ends the trial.
        self.trial = None;
        let valid = self.head?;
        self.versions.go_back::<F>(valid);
        let head = Head { first: self.versions.next::<F>(valid), length: 0, crc: 0 };
        Ok(Next { head, length: 0, digest: CRC.digest() })
    }

    /// Erases everything. The map's own erase keeps its cache: items written afterwards would not be found at the next start.
    async fn erase(&mut self) -> Result<(), StoreError> {
        let erased = self.map.as_mut().ok_or(StoreError::Failed)?.erase_all().await;
        self.map = self.map.take().map(|old| map(old.destroy().0));
        erased.map_err(reason)
    }

    /// Writes the last piece of `next`, of `bytes` bytes.
    async fn store_piece(&mut self, next: &Next, bytes: usize) -> Result<(), StoreError> {
        let nth = (next.length - 1) / PIECE_BYTES;
        self.give_up_version(Ring::<F>::place(next.head, nth)).await?;
        let key = Ring::<F>::key(next.head, nth);
        let piece = self.piece.get(..bytes).unwrap_or_default();
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        map.store_item(&mut self.buffer, &key, &piece).await.map_err(reason)
    }

    /// Appends `text` to `next`, and writes complete pieces.
    async fn extend(&mut self, next: &mut Next, mut text: &[u8]) -> Result<(), StoreError> {
        let bytes_max = text_bytes_max::<F>();
        if next.length + text.len() > bytes_max {
            return Err(StoreError::Full(bytes_max));
        }
        next.digest.update(text);
        while !text.is_empty() {
            let free = self.piece.get_mut(next.length % PIECE_BYTES..).unwrap_or_default();
            let (now, later) = text.split_at(text.len().min(free.len()));
            free.iter_mut().zip(now).for_each(|(to, &from)| *to = from);
            next.length += now.len();
            text = later;
            if next.length.is_multiple_of(PIECE_BYTES) {
                self.store_piece(next, PIECE_BYTES).await?;
            }
        }
        Ok(())
    }

    /// Commits `next`: writes the last piece, reads all back, then writes the head.
    async fn finish(&mut self, next: Next) -> Result<Head, StoreError> {
        let rest = next.length % PIECE_BYTES;
        if rest > 0 {
            self.store_piece(&next, rest).await?;
        }
        let head = Head { length: next.length as u32, crc: next.digest.finalize(), ..next.head };
        // A failed read-back is the medium's fault; the old text is still valid.
        self.check(&head).await.map_err(|_| StoreError::Failed)?;
        self.note_version(head).await?;
        if self.image.confirmed {
            self.put(HEAD_KEY, &head.to_bytes()).await?;
        } else {
            self.has_trial = true;
            self.put(TRIAL_KEY, &trial_to_bytes(head, self.image.id)).await?;
        }
        Ok(head)
    }
}

impl<F: NorFlash> Store for FlashStore<F> {
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        let Some(head) = self.valid()? else { return Ok(0) };
        self.read_text(head, offset, into).await
    }

    async fn append(&mut self, text: &[u8]) -> Result<(), StoreError> {
        // After an error it stays `None`, which discards the version.
        let mut next = match self.next.take() {
            Some(next) => next,
            None => self.begin().await?,
        };
        self.extend(&mut next, text).await?;
        self.next = Some(next);
        Ok(())
    }

    async fn commit(&mut self) -> Result<(), StoreError> {
        let next = match self.next.take() {
            Some(next) => next,
            None => self.begin().await?,
        };
        match self.finish(next).await {
            Ok(head) if self.image.confirmed => self.head = Ok(Some(head)),
            Ok(head) => self.trial = Some(head),
            Err(error) => {
                // The head may or may not have been written.
                self.find().await;
                return Err(error);
            }
        }
        Ok(())
    }

    fn sign(&mut self, who: &dyn fmt::Display, when: impl FnOnce() -> Option<u64>) {
        self.signed(Signature::of(who, when));
    }

    fn write_version(&mut self, nth: usize, out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        self.version(nth).map(|(_, told)| write!(out, "{told}"))
    }

    async fn read_version(
        &mut self,
        nth: usize,
        offset: usize,
        into: &mut [u8],
    ) -> Result<usize, StoreError> {
        let Some((head, _)) = self.version(nth) else { return Ok(0) };
        if offset == 0 {
            self.check(&head).await?;
        }
        self.read_text(head, offset, into).await
    }
}
