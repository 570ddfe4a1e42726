//! The settings' text in two sectors of NOR flash: after a power cut at any moment it is either the old text or the new one.
//!
//! Three layers. [`sectors`] makes erasing atomic. Above it, a map of sequential-storage finds the newest value of a key, checks
//! each by CRC, and spreads the wear over both sectors. [`FlashStore`] keeps texts in the map as pieces in a ring of places; a head
//! says where the valid one is, its length and its CRC. A save writes its pieces behind those of the valid text, reads them back, and
//! then writes the head: that single item commits. [`shared`] lets several consoles use the store.
//!
//! While new firmware is on trial, what is saved has a head of its own. If it is confirmed, those are the settings; if it goes back,
//! the old ones hold again.
//!
//! # Versions
//!
//! The texts before stay in the ring until a later one takes their places, the oldest first. With the feature `versions` a list has
//! the last ten, with who saved each, and when. The ring has 102 places for 1022 bytes each, twice what the longest text of a board
//! takes, so that one always fits.
//!
//! # What a save costs
//!
//! Settings of 2 KiB take 2 pieces and a head, so a sector takes some 60 saves before the other one is erased; with versions, which are
//! moved then, some 25. The first time after a start each piece is looked for through all items, up to 15 MB of reading, between which
//! other tasks run. Erasing takes as long as the chip says (1 s for 128 KiB is usual). Chips that can run code meanwhile carry on.
//! On others, every task stalls for that time: bytes from serial lines wait in DMA buffers, TCP peers retransmit, and timers that
//! expired during the stall see the received bytes first.
//!
//! Firmware upgrades keep the text, as long as the two sectors are not part of the image. A flash tool's full erase deletes it, and
//! the gateway starts with its defaults.
#![no_std]
#![forbid(unsafe_code)]

mod head;
pub mod sectors;
pub mod shared;
mod store;

pub use shared::SharedStore;
pub use store::{FlashStore, Image, SECRET_BYTES, TEXT_BYTES_MAX, text_bytes_max};
