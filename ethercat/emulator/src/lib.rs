//! An EtherCAT SubDevice controller (ESC) in software: frames in and out on one side, a processor on the other.
//!
//! In hardware a SubDevice has a controller chip that reads and changes EtherCAT frames while they pass, and a processor
//! behind the chip's process data interface (PDI). A [`Chip`] is the former at register level, so that a SubDevice stack
//! runs unchanged, and a MainDevice finds what it expects: type and features, DL and AL registers, FMMUs, SyncManagers with
//! mailboxes and triple buffers, watchdogs, events, error counters, the EEPROM with the SubDevice information, distributed
//! clocks as far as a start-up looks at them.
//!
//! It is good for development, tests and training, and with the feature `interface` for being a SubDevice on a network
//! interface of Linux, for cycles of a millisecond and more. It is no replacement for a chip where time counts: a frame
//! waits for a process to wake up, and the clock is that of the operating system.
//!
//! # A frame's way
//!
//! [`Chip::pass`] takes a frame. It looks at each datagram ([`frame`], [`command`]), reads and writes [`registers`] and
//! memory, for logical addresses through the [`fmmu`]s, and always through the SyncManagers ([`sync_manager`]). What a
//! frame changes takes effect at its end, and only if its check sequence was good, so a chip collects writes and throws
//! them away with a damaged frame. On a line of chips, [`Chip::pass_on`] says what comes before and behind.
//!
//! The processor's side is [`pdi`]: [`Chip::read`] and [`Chip::write`] as [`DirectPdi`], which is an
//! [`Esc`](ethercat_subdevice::esc::Esc), and the [`Interrupt`]. Both sides may be in one thread only; nothing blocks.
//!
//! # Testing a SubDevice
//!
//! * [`lan9252`]: the chip as firmware sees it, an SPI device and an interrupt pin, with faults and resets.
//! * [`MainDevice`] brings a SubDevice to a state and exchanges process data; the example `digital_io` of `ethercat-subdevice` runs it.
//!   With the feature `ethercrab`, `master` and [`sub_device`] run that crate's MainDevice instead.
//! * [`bench`](mod@bench): a SubDevice in a rig, for tests that ask for states, messages and process data one by one.
//! * [`segment`], [`cable`]: lines and rings of chips, with lost and damaged frames; [`pcap`] writes them down. With the feature
//!   `interface`, `packet` puts them to a network interface, for MainDevices in other programs.
//! * [`World`]: virtual time. Its driver of embassy-time is linked with this crate; a program has no other.
//!
//! The chip itself knows no clock: every access carries the time, in nanoseconds since any one moment. [`now`] is that of
//! embassy-time, which [`DirectPdi`] and [`Interrupt`] go by.
//!
//! ```
//! use ethercat_esc::frame::{Builder, datagrams};
//! use ethercat_esc::{Chip, Command, Kind};
//!
//! // With an EEPROM that nobody has written yet.
//! let mut chip = Chip::new(Kind::LAN9252, vec![]);
//! // A MainDevice counts devices: a broadcast read of the first register.
//! let mut frame = Builder::default().device(Command::Brd, 0, 0x0000, &[0]).build();
//! assert!(chip.pass(0, &mut frame));
//! let answer = datagrams(&mut frame).next().unwrap();
//! assert_eq!((answer.counter(), answer.data()), (1, &[0xC0][..]));
//! ```
//!
//! # Where it comes from
//!
//! Items name the chapter of Beckhoff's ESC data sheet that they follow, as in "I, SyncManager": section I is about the
//! technology, section II lists the registers by their addresses. It describes in public what ETG.1000.3 and ETG.1000.4
//! specify for the members of the EtherCAT Technology Group.
//!
//! # What it does not do
//!
//! - Nothing happens at a port but frames: no PHY management (MII, registers 0510h and following), no CRC errors of its own.
//! - Protection of registers against writing (0020h to 0031h), LEDs, digital inputs and outputs are absent.
//! - Distributed clocks have the receive times, system time, drift control and SYNC0; SYNC1 and latches are absent.
//! - What is written to the EEPROM is gone with the [`Chip`], unless its owner keeps
//!   [`Eeprom::content`](eeprom::Eeprom::content).
#![forbid(unsafe_code)]

mod access;
pub mod bench;
pub mod cable;
pub mod chip;
pub mod command;
mod dc;
pub mod eeprom;
mod effects;
mod events;
pub mod fmmu;
pub mod frame;
#[cfg(feature = "interface")] // It is one of Linux, and takes crates for that.
pub mod interface;
pub mod lan9252;
pub mod main_device;
#[cfg(feature = "ethercrab")] // It is a crate of its own.
pub mod master;
mod memory;
#[cfg(feature = "interface")] // As above.
pub mod packet;
mod passing;
pub mod pcap;
pub mod pdi;
mod ports;
pub mod probe;
pub mod registers;
mod reset;
mod reset_sequence;
pub mod segment;
pub mod sub_device;
pub mod sync_manager;
mod watchdog;

pub use cable::{Cable, FrameFaults, SharedSegment};
pub use chip::{Chip, Kind, SharedChip};
pub use command::Command;
pub use lan9252::Lan9252;
pub use main_device::MainDevice;
pub use mobgate_world::{self as world, Random, World};
pub use pdi::{DirectPdi, Interrupt};
pub use probe::Answer;
pub use segment::{Fate, Segment};

// The README's example is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

/// A time in nanoseconds since any one moment, the same for all accesses of a chip.
pub type Nanos = u64;

/// The present of embassy-time.
pub fn now() -> Nanos {
    embassy_time::Instant::now().as_micros() * 1_000
}
