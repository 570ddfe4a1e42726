//! Update files: signed firmware that says for which board it is, and which version.
//!
//! | offset in the file | bytes | |
//! | --- | --- | --- |
//! | 0 | 8 | magic, `MOBGATE` and the format's number 1 |
//! | 8 | 4 | bytes of the firmware, little-endian |
//! | 12 | 64 | ed25519 signature of the SHA-512 of the firmware |
//! | 76 | | the firmware: the flash's contents from the vector table on |
//!
//! The [info block](Info) is a part of the firmware, at a fixed offset behind the vector table, so the signature covers it. A
//! firmware has one by [`info!`], and the linker script memory.x puts it there. [`Receiver`] takes a file in pieces as they arrive
//! and refuses another board's, or an older one, as soon as its first [`DECIDED_BYTES`] are there. Who writes the firmware checks the
//! signature at the end, against [`PUBLIC_KEY`].
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing, clippy::panic, clippy::unwrap_used)]

mod header;
mod info;
mod key;
mod receiver;
mod version;

pub use header::{HEADER_BYTES, Header, SIGNATURE_BYTES};
pub use info::{BOARD_BYTES_MAX, INFO_BYTES, INFO_OFFSET, Info};
pub use key::{PUBLIC_KEY, PUBLIC_KEY_BYTES};
pub use receiver::{DECIDED_BYTES, Receiver, Refused};
pub use version::Version;
