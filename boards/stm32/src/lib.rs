//! Code shared by the STM32 boards. A board's `main.rs` sets up the clocks of its chip, and [`nucleo144::run`] does the rest.
//!
//! * [`nucleo144`]: pins and DMA channels of these boards; `interrupts`: their interrupts.
//! * `line`: an RS-485 line on a UART; `shift`: its interrupt; `lines`: the table of lines, which ports open by name.
//! * `flash`: the chip's flash for the settings; `start`: loading them at start-up, and the factory reset.
//! * `ethernet`: the MAC and its PHY; `network`: the stack on it and its sockets.
//! * `gateway`: the gateway's statics and tasks; `console`: the console's task; `ethercat`: the controller on SPI1.
//! * `clock`: the embassy-time driver.
//! * `system`: the console's interface to the board; `faults`: panics and faults; `watchdog`; `lights`.
//!
//! Caches: the instruction cache is on, the Cortex-M7's data cache is always off, so the program sees what DMA and Ethernet write,
//! in every memory.
#![no_std]

mod clock;
mod console;
// Images without it are smaller, see Cargo.toml.
#[cfg(feature = "ethercat")]
mod ethercat;
mod ethernet;
mod faults;
mod flash;
mod gateway;
mod interrupts;
mod lights;
mod line;
mod lines;
mod network;
pub mod nucleo144;
mod registers;
mod shift;
mod sockets;
mod start;
// Images without it are smaller, see Cargo.toml.
#[cfg(feature = "ethercat")]
mod states;
mod system;
mod watchdog;

use defmt_rtt as _;
