//! The STM32 boards in an emulator.
//!
//! A [`Machine`] runs the image of a board as it is built: Unicorn executes its instructions, and models written from the reference
//! manuals are the chip's peripherals. There is one clock, which no other clock moves: a run is the same each time. What no
//! model knows stops the run and is named.

mod bank;
mod bus;
mod cells;
mod character;
mod chip;
mod controller;
mod core;
mod cpu;
mod dma;
mod ethernet;
mod exti;
mod flash;
mod gpio;
mod hooks;
mod image;
mod lines;
mod machine;
mod mishaps;
mod network;
mod phy;
mod rcc;
mod spi;
mod time;
mod timer;
mod usart;
mod watchdog;
mod work;

pub use character::{CONSOLE, Character, Format, Parity, RTU};
pub use chip::{Board, Family, NUCLEO_F429ZI, NUCLEO_F767ZI, NUCLEO_H743ZI};
pub use controller::Controller;
pub use image::Image;
pub use lines::{Sent, Uart};
pub use machine::{Machine, Stop};
pub use network::{Client, Network};
pub use rcc::Reset;
