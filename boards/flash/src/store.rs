//! [`FlashStore`]: two copies of the text as numbered pieces in a map, and a head that says which one is valid.

use crc::{Digest, Table};
use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::{Store, StoreError};
use mobgate::settings::{LINE_BYTES_MAX, PORTS_MAX, ROUTES_MAX};
use sequential_storage::Error;
use sequential_storage::cache::Cache;
use sequential_storage::cache::key_pointers::ArrayKeyPointers;
use sequential_storage::cache::page_pointers::ArrayPagePointers;
use sequential_storage::cache::page_states::ArrayPageStates;
use sequential_storage::map::{MapConfig, MapStorage};

use crate::head::{CRC, HEAD_BYTES, Head};
use crate::sectors::{SECTORS, Sectors};

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
/// Keys of both copies and the head.
const KEYS: usize = 2 * PIECES_MAX + 1;
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
    let head = overhead + (KEY_BYTES + HEAD_BYTES).next_multiple_of(F::WRITE_SIZE);
    let pieces = (sector - head) / (2 * (overhead + KEY_BYTES + PIECE_BYTES));
    if pieces < PIECES_MAX { pieces * PIECE_BYTES } else { TEXT_BYTES_MAX }
}

/// Stores the settings in two sectors of `F`.
pub struct FlashStore<F: NorFlash> {
    /// `None` only while it is rebuilt.
    map: Option<Map<F>>,
    /// The valid copy, or why nothing can be read.
    head: Result<Option<Head>, StoreError>,
    /// Scratch buffer of the map for one item.
    buffer: [u8; KEY_BYTES + PIECE_BYTES],
    /// The version being written.
    next: Option<Next>,
    /// Its last, incomplete piece.
    piece: [u8; PIECE_BYTES],
}

/// A version being written.
struct Next {
    copy: u8,
    length: usize,
    digest: Digest<'static, u32, Table<1>>,
}

impl<F: NorFlash> FlashStore<F> {
    /// Opens the store in the two sectors at `start` of `flash`, and completes what a power cut interrupted. If the flash fails,
    /// nothing is read or written until the next start.
    pub async fn open(flash: F, start: u32) -> Self {
        let mut sectors = Sectors::new(flash, start);
        let prepared = sectors.prepare().await;
        let mut store = Self {
            map: Some(map(sectors)),
            head: Err(StoreError::Failed),
            buffer: [0; KEY_BYTES + PIECE_BYTES],
            next: None,
            piece: [0; PIECE_BYTES],
        };
        if prepared.is_ok() {
            store.head = store.find_head().await;
        }
        store
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
        let head = Head::from_bytes(bytes).ok_or(StoreError::Damaged)?;
        self.check(&head).await?;
        Ok(Some(head))
    }

    /// Checks the pieces against the head.
    async fn check(&mut self, head: &Head) -> Result<(), StoreError> {
        let length = head.length as usize;
        let mut digest = CRC.digest();
        for number in 0..length.div_ceil(PIECE_BYTES) {
            let bytes = PIECE_BYTES.min(length - number * PIECE_BYTES);
            digest.update(self.piece(head.copy, number).await?.get(..bytes).ok_or(StoreError::Damaged)?);
        }
        if digest.finalize() == head.crc { Ok(()) } else { Err(StoreError::Damaged) }
    }

    /// A piece of a copy. The last one may be longer than the rest of its text.
    async fn piece(&mut self, copy: u8, number: usize) -> Result<&[u8], StoreError> {
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        let found = map.fetch_item::<&[u8]>(&mut self.buffer, &key(copy, number)).await;
        found.map_err(reason)?.ok_or(StoreError::Damaged)
    }

    /// Starts a version in the copy that is not valid.
    async fn begin(&mut self) -> Result<Next, StoreError> {
        if self.head == Err(StoreError::Damaged) {
            // Nothing is readable, so nothing is lost, and damaged items might be in the way.
            self.erase().await?;
            self.head = Ok(None);
        }
        let holds = self.head?.map_or(1, |head| head.copy);
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
        let map = self.map.as_mut().ok_or(StoreError::Failed)?;
        map.store_item(&mut self.buffer, &HEAD_KEY, &head.to_bytes().as_slice()).await.map_err(reason)?;
        Ok(head)
    }
}

impl<F: NorFlash> Store for FlashStore<F> {
    async fn read(&mut self, offset: usize, into: &mut [u8]) -> Result<usize, StoreError> {
        let Some(head) = self.head? else { return Ok(0) };
        let left = (head.length as usize).saturating_sub(offset);
        if left == 0 {
            return Ok(0);
        }
        let piece = self.piece(head.copy, offset / PIECE_BYTES).await?;
        let there = piece.get(offset % PIECE_BYTES..).ok_or(StoreError::Damaged)?;
        let count = there.len().min(left).min(into.len());
        into.iter_mut().zip(there).take(count).for_each(|(to, &from)| *to = from);
        Ok(count)
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
            Ok(head) => self.head = Ok(Some(head)),
            Err(error) => {
                // The head may or may not have been written.
                self.head = self.find_head().await;
                return Err(error);
            }
        }
        Ok(())
    }
}

const fn key(copy: u8, number: usize) -> u16 {
    (copy as u16 * COPY_BIT) | number as u16
}

fn reason<E>(error: Error<E>) -> StoreError {
    match error {
        Error::Corrupted { .. } => StoreError::Damaged,
        _ => StoreError::Failed,
    }
}
