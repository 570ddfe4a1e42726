//! The settings' text in two sectors of NOR flash: after a power cut at any moment it is the old text or the new one.
//!
//! Three layers, each with one task. [`sectors`] makes erasing atomic. On it stands a map of sequential-storage, which finds
//! the newest value of a key, checks each with a CRC, and spreads the wear over both sectors. [`FlashStore`] keeps two copies
//! of the text in the map as numbered pieces; a head says which one holds, how long it is and what its CRC is. A save writes
//! the pieces of the other copy, reads them back, and then writes the head: that one item decides. [`shared`] lets several
//! consoles use the store.
//!
//! # What a save costs
//!
//! Settings of 2 KiB are 2 pieces and a head, so a sector takes some 60 saves before the other one is erased. Erasing takes
//! as long as the chip says (1 s for 128 KiB is usual). Where the chip can run code meanwhile, all goes on. Where
//! it cannot, every task stands still for that time: what arrives on serial lines waits in DMA buffers, what
//! arrives on TCP is sent again by the peers, and timers that ran out see the bytes first.
//!
//! Firmware upgrades leave the text alone, as long as the two sectors are no part of the image; a flash tool's full
//! erase takes it away, and the gateway starts with its defaults.
#![no_std]
#![forbid(unsafe_code)]

mod head;
pub mod sectors;
pub mod shared;
mod store;

pub use shared::SharedStore;
pub use store::{FlashStore, TEXT_BYTES_MAX, text_bytes_max};
