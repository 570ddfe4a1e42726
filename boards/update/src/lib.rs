//! New firmware for a board with a boot loader: [`hal::Update`](mobgate::hal::Update) on the board's flash.
//!
//! [`Updater`] takes an update file in pieces, writes its firmware into the update's partition, reads each piece back and hashes what it has read. If
//! the signature is right, the state's partition tells the boot loader to swap the images at the next start. The new one then runs on trial: the
//! board [confirms](Updater::confirm) it after a self-test, or else the boot loader swaps back. What runs is never touched.
#![no_std]
#![forbid(unsafe_code)]

mod origin;
mod partition;
mod updater;
mod writer;

pub use origin::{REASON_BYTES_MAX, Reason};
pub use partition::Partition;
pub use updater::{Trust, Updater};
