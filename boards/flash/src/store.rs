//! [`FlashStore`]: two copies of the text as numbered pieces in a map, and a head that says which one is valid.
//!
//! While an image is on trial, the head stays as it is: what is saved goes to the other copy, with a head of its own that names the
//! image. Confirming makes that the head. If another image runs at the next start, that one went back, and its head is dropped.

use core::fmt;

use crc::{Digest, NoTable};
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::{Store, StoreError};
use mobgate::settings::{LINE_BYTES_MAX, PORTS_MAX, ROUTES_MAX};
use sequential_storage::Error;
use sequential_storage::cache::Cache;
use sequential_storage::cache::key_pointers::ArrayKeyPointers;
use sequential_storage::cache::page_pointers::ArrayPagePointers;
use sequential_storage::cache::page_states::ArrayPageStates;
use sequential_storage::map::{MapConfig, MapStorage};

use crate::head::{CRC, Head, TRIAL_BYTES, trial_from_bytes, trial_to_bytes};
use crate::sectors::{SECTORS, Sectors};

// Images without it are smaller: nobody asks for a version there.
#[cfg_attr(not(feature = "versions"), path = "store/no_version_items.rs")]
mod version_items;
#[cfg_attr(not(feature = "versions"), path = "store/no_versions.rs")]
mod versions;

mod secret;

pub use self::secret::SECRET_BYTES;
use self::versions::{VERSION_BYTES_MAX, Versions};
pub(crate) use self::versions::{Who, who};

/// Longest text: room for the network, all ports and all rules as lines of full length. The other lines share it; a longer text
/// fails with [`StoreError::Full`].
pub const TEXT_BYTES_MAX: usize = (PORTS_MAX + ROUTES_MAX + 1) * (LINE_BYTES_MAX + 1);

/// Bytes of a piece. With its key it is a whole number of flash words.
const PIECE_BYTES: usize = 1024 - KEY_BYTES;
const KEY_BYTES: usize = size_of::<u16>();
const PIECES_MAX: usize = TEXT_BYTES_MAX.div_ceil(PIECE_BYTES);
/// The head's key. A piece's key is its number and, in [`COPY_BIT`], its copy.
const HEAD_KEY: u16 = u16::MAX;
const COPY_BIT: u16 = 0x100;
/// The key of a trial's head.
const TRIAL_KEY: u16 = HEAD_KEY - 1;
/// Keys of both copies and the heads. That of the secret is looked for once.
const KEYS: usize = 2 * PIECES_MAX + 2;
const _: () = assert!(PIECES_MAX < COPY_BIT as usize);

type Finder = Cache<
    ArrayPageStates<{ SECTORS as usize }>,
    ArrayPagePointers<{ SECTORS as usize }>,
    ArrayKeyPointers<u16, KEYS>,
    u16,
>;

type Map<F> = MapStorage<u16, Sectors<F>, Finder>;

/// A map with an empty cache.
fn map<F: NorFlash>(sectors: Sectors<F>) -> Map<F> {
    let finder = Cache::new(ArrayPageStates::new(), ArrayPagePointers::new(), ArrayKeyPointers::new());
    let config = const { MapConfig::new(0..SECTORS * <Sectors<F> as NorFlash>::ERASE_SIZE as u32) };
    MapStorage::new(sectors, config, finder)
}

/// Longest text for two sectors of `F`: both copies must fit into one, because the other one is being erased.
pub const fn text_bytes_max<F: NorFlash>() -> usize {
    let sector = <Sectors<F> as NorFlash>::ERASE_SIZE - 2 * F::WRITE_SIZE;
    let overhead = MapStorage::<u16, Sectors<F>, Finder>::item_overhead_size() as usize;
    let head = overhead + (KEY_BYTES + TRIAL_BYTES).next_multiple_of(F::WRITE_SIZE);
    let secret = overhead + (KEY_BYTES + SECRET_BYTES).next_multiple_of(F::WRITE_SIZE);
    let version = overhead + (KEY_BYTES + VERSION_BYTES_MAX).next_multiple_of(F::WRITE_SIZE);
    let versions = if cfg!(feature = "versions") { 2 * version } else { 0 };
    let pieces = (sector - 2 * head - secret - versions) / (2 * (overhead + KEY_BYTES + PIECE_BYTES));
    let room = pieces * PIECE_BYTES;
    if room < TEXT_BYTES_MAX { room } else { TEXT_BYTES_MAX }
}

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
    /// The valid copy, or why nothing can be read.
    head: Result<Option<Head>, StoreError>,
    /// The copy saved by the image on trial, which is valid until the image goes back.
    trial: Option<Head>,
    /// Whether the flash has a trial's head.
    has_trial: bool,
    /// Scratch buffer of the map for one item.
    buffer: [u8; KEY_BYTES + PIECE_BYTES],
    /// The version being written.
    next: Option<Next>,
    /// Its last, incomplete piece.
    piece: [u8; PIECE_BYTES],
    /// Who saved the texts.
    versions: Versions,
}

/// A version being written.
struct Next {
    copy: u8,
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

    /// The head of this image's trial, if its text matches it. Once confirmed it names the same copy as the head, and is over.
    async fn find_trial(&mut self) -> Result<Option<Head>, StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let found = map.fetch_item::<&[u8]>(&mut self.buffer, &TRIAL_KEY).await.map_err(reason)?;
        let bytes = found.unwrap_or_default();
        self.has_trial = !bytes.is_empty();
        let Some((head, image)) = trial_from_bytes(bytes) else { return Ok(None) };
        let is_over = matches!(self.head, Ok(Some(Head { copy, .. })) if copy == head.copy);
        if is_over || image != self.image.id {
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
        for number in 0..length.div_ceil(PIECE_BYTES) {
            let bytes = PIECE_BYTES.min(length - number * PIECE_BYTES);
            digest.update(self.piece(head.copy, number).await?.get(..bytes).ok_or(StoreError::Corrupt)?);
        }
        if digest.finalize() == head.crc { Ok(()) } else { Err(StoreError::Corrupt) }
    }

    /// A piece of a copy. The last one may be longer than the rest of its text.
    async fn piece(&mut self, copy: u8, number: usize) -> Result<&[u8], StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let found = map.fetch_item::<&[u8]>(&mut self.buffer, &key(copy, number)).await;
        found.map_err(reason)?.ok_or(StoreError::Corrupt)
    }

    /// The head of the text that is valid, if there is one.
    fn valid(&self) -> Result<Option<Head>, StoreError> {
        self.trial.map_or(self.head, |head| Ok(Some(head)))
    }

    /// Reads the text of a head from `offset` on.
    async fn read_copy(&mut self, head: Head, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        let left = (head.length as usize).saturating_sub(offset);
        if left == 0 {
            return Ok(0);
        }
        let piece = self.piece(head.copy, offset / PIECE_BYTES).await?;
        let there = piece.get(offset % PIECE_BYTES..).ok_or(StoreError::Corrupt)?;
        let count = there.len().min(left).min(into.len());
        into.iter_mut().zip(there).take(count).for_each(|(to, &from)| *to = from);
        Ok(count)
    }

    /// Starts a version in the copy that is not valid.
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
        let holds = self.head?.map_or(1, |head| head.copy);
        self.versions.forget(1 - holds);
        Ok(Next { copy: 1 - holds, length: 0, digest: CRC.digest() })
    }

    /// Erases everything. The map's own erase keeps its cache: items written afterwards would not be found at the next start.
    async fn erase(&mut self) -> Result<(), StoreError> {
        let erased = self.map.as_mut().ok_or(StoreError::Failed)?.erase_all().await;
        self.map = self.map.take().map(|old| map(old.destroy().0));
        erased.map_err(reason)
    }

    /// Writes the last piece of `next`, of `bytes` bytes.
    async fn store_piece(&mut self, next: &Next, bytes: usize) -> Result<(), StoreError> {
        let piece = self.piece.get(..bytes).unwrap_or_default();
        let key = key(next.copy, (next.length - 1) / PIECE_BYTES);
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
        let head = Head { copy: next.copy, length: next.length as u32, crc: next.digest.finalize() };
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
        self.read_copy(head, offset, into).await
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

    fn sign(&mut self, who: &dyn fmt::Display) {
        self.versions.sign(who);
    }

    fn write_version(&mut self, nth: usize, out: &mut dyn fmt::Write) -> Option<fmt::Result> {
        self.version(nth).map(|(_, who)| write!(out, "-\t-\t{who}"))
    }

    async fn read_version(
        &mut self,
        nth: usize,
        offset: usize,
        into: &mut [u8],
    ) -> Result<usize, StoreError> {
        let Some((head, _)) = self.version(nth) else { return Ok(0) };
        self.read_copy(head, offset, into).await
    }
}

const fn key(copy: u8, number: usize) -> u16 {
    (copy as u16 * COPY_BIT) | number as u16
}

fn reason<E>(error: Error<E>) -> StoreError {
    match error {
        Error::Corrupted { .. } => StoreError::Corrupt,
        _ => StoreError::Failed,
    }
}
