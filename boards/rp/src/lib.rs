//! Code for boards with an RP2040 and a W5500. A board's `main.rs` names it, and [`pico::run`] does the rest.
//!
//! * [`pico`]: pins and channels of a Raspberry Pi Pico with a W5500.
//! * `line`: an RS-485 line on two state machines of a PIO; `character`: its characters; `program`: the programs of the PIO.
//! * `ethernet`: the W5500; `console`: the console by USB; `flash`: the chip's flash for settings and updates.
//! * `start`: why it started, and faults; `light`: the one light.
#![no_std]

mod character;
mod console;
mod ethernet;
mod flash;
mod light;
mod line;
pub mod pico;
mod program;
mod start;

use defmt_rtt as _;
// Linked for the atomics of libraries.
use portable_atomic as _;
