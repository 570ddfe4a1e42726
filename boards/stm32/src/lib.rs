//! What the STM32 boards share. A board's `main.rs` sets the clocks of its chip, and [`nucleo144::run`] does the rest.
//!
//! * [`nucleo144`]: the pins and DMA channels of these boards; `interrupts`: their interrupts.
//! * `line`: an RS-485 line on a UART, and `lines`, the table of them that ports open by name.
//! * `flash`: the chip's flash for the settings; `start`: how they are read at the start, and the factory reset.
//! * `ethernet`: the MAC and its PHY; `network`: the stack over it and its sockets.
//! * `gateway`: the statics and the tasks of the gateway, `console` the console's. `ethercat`: the controller at SPI1.
//! * `clock`: embassy-time's.
//! * `system`: the board as the console sees it; `faults`: what becomes of a panic; `watchdog`; `lights`.
//!
//! Caches: the instruction cache is on, the data cache of the Cortex-M7 never is, so what DMA and the Ethernet write is what
//! the program reads, in every memory.
#![no_std]

mod clock;
mod console;
// Images without are smaller, see Cargo.toml.
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
mod sockets;
mod start;
// Images without are smaller, see Cargo.toml.
#[cfg(feature = "ethercat")]
mod states;
mod system;
mod watchdog;

use defmt_rtt as _;
