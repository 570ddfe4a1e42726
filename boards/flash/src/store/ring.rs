//! The ring: places for pieces. All of them and everything else fit into one sector, because the other one is being erased.
//!
//! A text takes places in a row, and the next text those behind it, where the oldest ones are. Half of the places are enough for the
//! longest text, so that the next one never touches the text that is valid. There are no more places than that takes: what is in them
//! is moved each time when a sector is full, and the fuller it is then, the sooner comes the next time.
//!
//! The halves are what firmware before had for two copies of the text. The keys are the same, so that what it has saved is read, and
//! takes no room of its own.

use core::marker::PhantomData;

use embedded_storage_async::nor_flash::NorFlash;

use super::items::{HALF_MAX, PIECE_BYTES, SECRET_BYTES, TEXT_BYTES_MAX, item_bytes, sector_bytes};
use crate::head::{HEAD_BYTES, Head, TRIAL_BYTES};

/// Versions that are kept, the valid text among them. Images without them leave the room, so that each reads the other's settings.
pub(super) const VERSIONS_MAX: usize = 10;
/// Bytes of who saved a version.
const WHO_BYTES_MAX: usize = 52;
/// Bytes of when a version was saved, and by whom.
pub(super) const SIGNATURE_BYTES: usize = size_of::<u32>() + WHO_BYTES_MAX;
/// Bytes of what is known of a version: its head and its signature.
pub(super) const RECORD_BYTES: usize = HEAD_BYTES + SIGNATURE_BYTES;
/// Bytes of the same in firmware before, which had an item for each copy. The list takes the place of one of them.
const COPY_RECORD_BYTES: usize = HEAD_BYTES + WHO_BYTES_MAX;

// A head has seven bits for them.
const _: () = assert!(HALF_MAX < 128);
/// Set in the keys of the second half.
pub(super) const HALF_BIT: u16 = 0x100;

/// The ring in two sectors of `F`.
pub(super) struct Ring<F>(PhantomData<F>);

impl<F: NorFlash> Ring<F> {
    /// Places of a half.
    pub(super) const HALF: usize = {
        let mut half = HALF_MAX;
        while live_bytes::<F>(2 * half) > sector_bytes::<F>() {
            half -= 1;
        }
        assert!(half > 0, "each half has a place");
        half
    };

    pub(super) const PLACES: usize = 2 * Self::HALF;

    /// The place of a text's piece `nth`.
    pub(super) fn place(head: Head, nth: usize) -> usize {
        let (half, number) = (usize::from(head.first & 1), usize::from(head.first >> 1));
        (half * Self::HALF + number + nth) % Self::PLACES
    }

    /// The key of a text's piece `nth`.
    pub(super) fn key(head: Head, nth: usize) -> u16 {
        let place = Self::place(head, nth);
        match place.checked_sub(Self::HALF) {
            None => place as u16,
            Some(number) => HALF_BIT | number as u16,
        }
    }

    /// Where a text begins that follows that of `head`.
    pub(super) fn behind(head: Head) -> u8 {
        let key = Self::key(head, pieces(head));
        (((key % HALF_BIT) << 1) | (key / HALF_BIT)) as u8
    }
}

/// Pieces of a text.
pub(super) fn pieces(head: Head) -> usize {
    (head.length as usize).div_ceil(PIECE_BYTES)
}

/// Most versions among so many places.
pub(super) const fn versions_max(places: usize) -> usize {
    if places < VERSIONS_MAX { places } else { VERSIONS_MAX }
}

/// What is live at most: all items, and the piece that replaces one of them.
const fn live_bytes<F: NorFlash>(places: usize) -> usize {
    let heads = 2 * item_bytes::<F>(TRIAL_BYTES);
    let versions = item_bytes::<F>(versions_max(places) * RECORD_BYTES) + item_bytes::<F>(COPY_RECORD_BYTES);
    (places + 1) * item_bytes::<F>(PIECE_BYTES) + heads + item_bytes::<F>(SECRET_BYTES) + versions
}

/// Longest text for two sectors of `F`.
pub const fn text_bytes_max<F: NorFlash>() -> usize {
    let room = Ring::<F>::HALF * PIECE_BYTES;
    if room < TEXT_BYTES_MAX { room } else { TEXT_BYTES_MAX }
}
