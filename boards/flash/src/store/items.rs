//! The map of the items: its keys, and what an item takes of the flash.

use embedded_storage_async::nor_flash::NorFlash;
use mobgate::hal::StoreError;
use mobgate::settings::{LINE_BYTES_MAX, PORTS_MAX, ROUTES_MAX};
use sequential_storage::Error;
use sequential_storage::cache::Cache;
use sequential_storage::cache::key_pointers::ArrayKeyPointers;
use sequential_storage::cache::page_pointers::ArrayPagePointers;
use sequential_storage::cache::page_states::ArrayPageStates;
use sequential_storage::map::{MapConfig, MapStorage};

use crate::sectors::{SECTORS, Sectors};

/// Longest text: room for the network, all ports and all rules as lines of full length. The other lines share it; a longer text
/// fails with [`StoreError::Full`].
pub const TEXT_BYTES_MAX: usize = (PORTS_MAX + ROUTES_MAX + 1) * (LINE_BYTES_MAX + 1);

/// Bytes of the secret.
pub const SECRET_BYTES: usize = 32;

pub(super) const KEY_BYTES: usize = size_of::<u16>();
/// Bytes of a piece. With its key it is a whole number of flash words.
pub(super) const PIECE_BYTES: usize = 1024 - KEY_BYTES;
/// The head's key. Those of pieces are their places in the ring.
pub(super) const HEAD_KEY: u16 = u16::MAX;
/// The key of a trial's head.
pub(super) const TRIAL_KEY: u16 = HEAD_KEY - 1;
/// Most places of a half of the ring: the pieces of a board's longest text. With paths a text may be longer, on hosts, which have no
/// such flash.
pub(super) const HALF_MAX: usize = if PIECES_MAX < 51 { PIECES_MAX } else { 51 };
const PIECES_MAX: usize = TEXT_BYTES_MAX.div_ceil(PIECE_BYTES);
/// All keys: those of the places, the heads, the secret and the versions. When a sector is full, each one that is not known is looked
/// for through all items.
const KEYS: usize = 2 * HALF_MAX + 5;

type Finder = Cache<
    ArrayPageStates<{ SECTORS as usize }>,
    ArrayPagePointers<{ SECTORS as usize }>,
    ArrayKeyPointers<u16, KEYS>,
    u16,
>;

pub(super) type Map<F> = MapStorage<u16, Sectors<F>, Finder>;

/// A map with an empty cache.
pub(super) fn map<F: NorFlash>(sectors: Sectors<F>) -> Map<F> {
    let finder = Cache::new(ArrayPageStates::new(), ArrayPagePointers::new(), ArrayKeyPointers::new());
    let config = const { MapConfig::new(0..SECTORS * <Sectors<F> as NorFlash>::ERASE_SIZE as u32) };
    MapStorage::new(sectors, config, finder)
}

/// Bytes of a sector that items can take.
pub(super) const fn sector_bytes<F: NorFlash>() -> usize {
    <Sectors<F> as NorFlash>::ERASE_SIZE - 2 * F::WRITE_SIZE
}

/// Bytes that an item of `bytes` takes.
pub(super) const fn item_bytes<F: NorFlash>(bytes: usize) -> usize {
    Map::<F>::item_overhead_size() as usize + (KEY_BYTES + bytes).next_multiple_of(F::WRITE_SIZE)
}

pub(super) fn reason<E>(error: Error<E>) -> StoreError {
    match error {
        Error::Corrupted { .. } => StoreError::Corrupt,
        _ => StoreError::Failed,
    }
}
