//! An EtherCAT SubDevice controller (ESC) at register level: frames in and out on one side, a processor on the other.
//!
//! A frame goes through a [`Segment`], a line of [`Chip`]s. Each chip looks at every datagram ([`frame`], [`command`]), reads and
//! writes its [`registers`] and memory, by logical address through its [`fmmu`]s, always through its SyncManagers
//! ([`sync_manager`]). What a frame changes takes effect at its end and only if its check sequence is good, so a chip collects
//! writes and throws them away with a damaged frame. The processor's side is [`pdi`]: direct accesses in virtual
//! time, and the interrupt.
//!
//! The chip itself knows no clock: every access carries the time, in nanoseconds.

mod access;
pub mod cable;
pub mod chip;
pub mod command;
mod dc;
pub mod eeprom;
mod effects;
mod events;
pub mod fmmu;
pub mod frame;
#[cfg(feature = "masters")] // The demo that ships runs no MainDevice.
pub mod master;
mod memory;
#[cfg(feature = "masters")] // Likewise.
pub mod packet;
mod passing;
pub mod pcap;
pub mod pdi;
pub mod probe;
pub mod registers;
mod reset;
pub mod segment;
pub mod sync_manager;
mod watchdog;

pub use cable::{Cable, FrameFaults, SharedSegment};
pub use chip::{Chip, Kind};
pub use command::Command;
pub use pdi::{DirectPdi, Interrupt, SharedChip};
pub use probe::Answer;
pub use segment::{Fate, Segment};

/// A time in nanoseconds since the world began.
pub type Nanos = u64;

/// The present of embassy-time.
pub fn now() -> Nanos {
    embassy_time::Instant::now().as_micros() * 1_000
}
