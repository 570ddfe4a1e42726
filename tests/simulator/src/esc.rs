//! Networks of emulated EtherCAT controllers: lines and rings of them, cables with faults, and MainDevices in front.
//!
//! The controller itself is the library `ethercat-esc`, whose items are here as well. A frame goes through a [`Segment`], a line of
//! [`Chip`]s, after a [`Cable`] that may lose or damage it, or from a network interface ([`packet`]).

pub mod cable;
#[cfg(feature = "masters")] // The demo that ships runs no MainDevice.
pub mod master;
#[cfg(feature = "masters")] // Likewise.
pub mod packet;
pub mod pcap;
pub mod probe;
pub mod segment;

pub use cable::{Cable, FrameFaults, SharedSegment};
pub use ethercat_esc::{
    Chip, Command, DirectPdi, Interrupt, Kind, Nanos, SharedChip, eeprom, frame, now, registers,
};
pub use probe::Answer;
pub use segment::{Fate, Segment};
