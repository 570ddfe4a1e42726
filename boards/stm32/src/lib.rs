//! Code shared by the STM32 boards, under what `mobgate-firmware` shares among all chips. A board's `main.rs` sets up the clocks of its
//! chip, and [`nucleo144::run`] does the rest.
//!
//! * [`nucleo144`]: pins and DMA channels of these boards, and their tasks; `interrupts`: their interrupts; `lights`: theirs.
//! * `line`: an RS-485 line on a UART; `shift`: its interrupt.
//! * `flash`: the chip's flash for the settings.
//! * `ethernet`: the MAC and its PHY; `ethercat`: the controller on SPI1; `spi`: its transfers.
//! * `clock`: the embassy-time driver; `registers`: what differs between the families; `random`: random numbers; `faults`: panics and faults.
//!
//! Caches: the instruction cache is on, the Cortex-M7's data cache is always off, so the program sees what DMA and Ethernet write,
//! in every memory.
#![no_std]
// The types of the web interface's futures are deep.
#![recursion_limit = "256"]

mod clock;
// Images without it are smaller, see Cargo.toml.
#[cfg(feature = "ethercat")]
mod ethercat;
mod ethernet;
mod faults;
mod flash;
mod interrupts;
mod lights;
mod line;
pub mod nucleo144;
// Images without users need none.
#[cfg(feature = "users")]
mod random;
mod registers;
mod shift;
// Only the controller is on it.
#[cfg(feature = "ethercat")]
mod spi;

use defmt_rtt as _;
