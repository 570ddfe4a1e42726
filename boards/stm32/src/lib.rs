//! What the STM32 boards share. A board's `main.rs` names its chip's pins, clocks and DMA channels, and hands them over;
//! here is what becomes of them.
//!
//! * [`line`]: an RS-485 line on a UART, and [`lines`], the table of them that ports open by name.
//! * [`flash`]: the chip's flash for the settings; [`start`]: how they are read at the start, and the factory reset.
//! * [`network`]: the Ethernet, its stack and sockets.
//! * [`gateway`]: the statics and the tasks of the gateway, [`console`] the console's. `ethercat`: the controller at SPI1.
//! * [`system`]: the board as the console sees it; [`faults`]: what becomes of a panic; [`watchdog`]; [`lights`].
//!
//! Caches: the instruction cache is on, the data cache of the Cortex-M7 never is, so what DMA and the Ethernet write is what
//! the program reads, in every memory.
#![no_std]

pub mod console;
// Images without are smaller, see Cargo.toml.
#[cfg(feature = "ethercat")]
pub mod ethercat;
mod faults;
pub mod flash;
pub mod gateway;
pub mod lights;
pub mod line;
pub mod lines;
pub mod network;
// Images without are smaller, see Cargo.toml.
#[cfg(feature = "ethercat")]
mod places;
mod registers;
pub mod sockets;
pub mod start;
pub mod system;
pub mod watchdog;

pub use embassy_stm32;

use defmt_rtt as _;
