//! The gateway on QEMU's mps2-an386, with simulated devices at its UARTs and clients in its network, on the wall clock.
//!
//! [`Machine`] starts the emulator. [`Bus`] is an RTU line with devices on it, served by a thread; [`Client`] a Modbus TCP client;
//! [`Console`] a session at the board's terminal; [`Figures`] what the board tells about itself. [`Controller`] is an EtherCAT
//! controller at the board's SPI, with MainDevices at its cable.

pub mod bus;
pub mod client;
pub mod console;
pub mod controller;
pub mod cost;
pub mod image;
pub mod machine;
pub mod pages;
mod passing;
pub mod shift;
pub mod soak;

#[path = "../../../benches/figures/figure.rs"]
mod figure;
// What of the board a host can test.
#[cfg(test)]
#[path = "../../../boards/qemu_mps2/src/transmitter.rs"]
mod transmitter;

pub use bus::Bus;
pub use client::Client;
pub use console::{Console, Figures};
pub use controller::Controller;
pub use image::Image;
pub use machine::{Machine, Options};
pub use mobgate_simulator::waiting::{PATIENCE, wait_for};
