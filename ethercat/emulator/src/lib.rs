//! An EtherCAT SubDevice controller (ESC) in software: frames in and out on one side, a processor on the other.
//!
//! In hardware a SubDevice has a controller chip that reads and modifies EtherCAT frames on the fly, and a processor behind the
//! chip's process data interface (PDI). A [`Chip`] emulates the former at register level, so that a SubDevice stack runs unchanged,
//! and a MainDevice finds what it expects: type and features, DL and AL registers, FMMUs, SyncManagers with mailboxes and triple
//! buffers, watchdogs, events, error counters, the EEPROM with the SubDevice information, and distributed clocks with
//! SYNC and LATCH signals.
//!
//! Use it for development, tests and training; with the feature `interface` it can be a SubDevice on a Linux network interface, at
//! cycles of a millisecond and more. It does not replace a chip where timing matters: a frame waits for a process to wake up, and
//! the clock is that of the operating system.
//!
//! # Path of a frame
//!
//! [`Chip::pass`] takes a frame. It decodes each datagram ([`frame`], [`command`]), reads and writes [`registers`] and memory, for
//! logical addresses through the [`fmmu`]s, and always through the SyncManagers ([`sync_manager`]). A frame's writes take effect at
//! its end, and only if its FCS was good, so a chip collects writes and discards them with a corrupt frame. On a line of chips use
//! [`Chip::pass_on`], which also takes the frame's return time from the chips behind.
//!
//! The processor's side is [`pdi`]: [`Chip::read`] and [`Chip::write`] as [`DirectPdi`], which is an
//! [`Esc`](ethercat_subdevice::esc::Esc), and the [`Interrupt`]. Both sides may be in one thread only; nothing blocks.
//!
//! # Testing a SubDevice
//!
//! * [`lan9252`]: the chip as firmware sees it, an SPI device and an interrupt pin, with faults and resets.
//! * [`MainDevice`] brings a SubDevice to a state and exchanges process data; the example `digital_io` of `ethercat-subdevice`
//!   uses it.
//!   With the feature `ethercrab`, `master` and [`sub_device`] run that crate's MainDevice instead.
//! * [`bench`](mod@bench): a SubDevice in a rig, for tests that request states, messages and process data step by step.
//! * [`segment`], [`cable`]: lines and rings of chips, with lost and corrupt frames; [`pcap`] captures them. With the feature
//!   `interface`, `packet` connects them to a network interface, for MainDevices in other programs.
//! * [`World`]: virtual time. This crate links its driver of embassy-time; a program cannot have another.
//!
//! The chip itself has no clock: every access carries the time in nanoseconds, relative to any fixed instant. [`now`] takes it from
//! embassy-time, as [`DirectPdi`] and [`Interrupt`] do.
//!
//! ```
//! use ethercat_esc::frame::{Builder, datagrams};
//! use ethercat_esc::{Chip, Command, Kind};
//!
//! // An EEPROM without content.
//! let mut chip = Chip::new(Kind::LAN9252, vec![]);
//! // A MainDevice counts devices: a broadcast read of the first register.
//! let mut frame = Builder::default().device(Command::Brd, 0, 0x0000, &[0]).build();
//! assert!(chip.pass(0, &mut frame));
//! let response = datagrams(&mut frame).next().unwrap();
//! assert_eq!((response.counter(), response.data()), (1, &[0xC0][..]));
//! ```
//!
//! # Sources
//!
//! Items name the chapter of Beckhoff's ESC data sheet that they implement, as in "I, SyncManager": section I describes the
//! technology, section II the registers by address. The data sheet publicly describes what ETG.1000.3 and ETG.1000.4 specify for
//! members of the EtherCAT Technology Group.
//!
//! # Limitations
//!
//! - Ports carry only frames: no PHY management (MII, registers 0510h and following), no CRC errors.
//! - Register write protection (0020h to 0031h), LEDs, and digital inputs and outputs are absent.
//! - The control loop of distributed clocks corrects half of each difference at once, where a chip changes its clock's speed.
//! - Writes to the EEPROM are lost with the [`Chip`], unless its owner saves
//!   [`Eeprom::content`](eeprom::Eeprom::content).
#![forbid(unsafe_code)]

mod access;
#[cfg(feature = "bench")] // The controller alone needs no simulated network.
pub mod bench;
#[cfg(feature = "bench")]
pub mod cable;
pub mod chip;
pub mod command;
mod dc;
pub mod eeprom;
mod effects;
mod events;
pub mod fmmu;
pub mod frame;
#[cfg(feature = "interface")] // Linux only, and needs additional crates.
pub mod interface;
#[cfg(feature = "bench")]
pub mod lan9252;
pub mod main_device;
#[cfg(feature = "ethercrab")] // Needs the ethercrab crate.
pub mod master;
mod memory;
#[cfg(all(feature = "bench", feature = "interface"))]
pub mod packet;
mod passing;
pub mod pcap;
pub mod pdi;
mod ports;
pub mod probe;
pub mod registers;
mod reset;
mod reset_sequence;
#[cfg(feature = "bench")]
pub mod samples;
pub mod segment;
#[cfg(feature = "bench")]
pub mod sub_device;
pub mod sync_manager;
mod watchdog;

#[cfg(feature = "bench")]
pub use cable::{Cable, FrameFaults, SharedSegment};
pub use chip::{Chip, Kind, SharedChip};
pub use command::Command;
pub use dc::sync::SyncLine;
#[cfg(feature = "bench")]
pub use lan9252::Lan9252;
pub use main_device::MainDevice;
#[cfg(feature = "bench")]
pub use mobgate_world::{self as world, Random, World};
pub use pdi::{DirectPdi, Interrupt, SyncPin};
pub use probe::Response;
pub use segment::{Fate, Segment};

// Tests the README's example.
#[cfg(all(doctest, feature = "bench"))]
#[doc = include_str!("../README.md")]
struct Readme;

/// A time in nanoseconds since a fixed instant, the same for all accesses of a chip.
pub type Nanos = u64;

/// The current time of embassy-time.
pub fn now() -> Nanos {
    embassy_time::Instant::now().as_micros() * 1_000
}
