//! The STM32 boards in an emulator.
//!
//! A [`Machine`] runs the image of a board as it is built: Unicorn executes its instructions, and models written from the reference
//! manuals are the chip's peripherals. There is one clock, which no other clock moves: a run is the same each time. What no
//! model knows stops the run and is named.
//!
//! # How a run goes
//!
//! [`Machine::run`] lets the processor (`cpu`, `hooks`) execute instructions until something is due: a character's end, a compare of the
//! timer, the end of an erasure. Then all peripherals do what is due (`bus`), DMA moves what follows from it, and interrupts are taken.
//! A processor that sleeps lets time leap to the next event. Accesses to peripherals (`access`) go by their addresses (`chip`) to `rcc`, `flash` and
//! its `cells`, `usart`, `dma`, `spi`, `ethernet`, `phy`, `timer`, `random`, `watchdog`, `gpio`, `exti` and `core`; registers that only keep
//! what is written are a `bank`.
//!
//! # What is at the connectors
//!
//! * A terminal, and stations on the RS-485 lines: [`Machine::type_line`], [`Machine::send`], [`Machine::sent`]. [`Character`]s are
//!   heard bit by bit, at the receiver's speed and parity.
//! * A [`Network`] with Modbus TCP clients.
//! * A [`Controller`] for EtherCAT, with a MainDevice, or with ethercrab.
//! * Power, a PHY, a cable and a program that fail: [`Machine::cut_power_at`] and its neighbours.
//!
//! # What differs from the chips
//!
//! Each instruction takes one cycle, and lies in the flash: to execute one elsewhere is a fault. There are no wait states and no bus
//! contention, and nothing is cached (`caches` notices where that would do harm); a register has its effect at once. A bus fault is
//! taken at the end of the block of instructions. Registers of the floating-point unit do not lie on the stack in an exception.

mod access;
mod bank;
mod bus;
mod caches;
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
mod foe;
mod gpio;
mod hooks;
mod image;
mod lines;
mod machine;
mod mishaps;
mod network;
mod phy;
mod random;
mod rcc;
mod spi;
mod time;
mod timer;
mod updates;
mod usart;
mod watchdog;
mod wiring;
mod work;

pub use character::{CONSOLE, Character, Format, Parity, RTU};
pub use chip::{Board, Family, NUCLEO_F429ZI, NUCLEO_F767ZI, NUCLEO_H743ZI};
pub use controller::Controller;
pub use ethercat_esc::sub_device::Dispatcher;
pub use foe::FileRefusal;
pub use image::{Image, update_file};
pub use lines::{Sent, Uart, ends_with_prompt};
pub use machine::{Machine, Stop};
pub use network::{Client, Datagrams, Network, Sender};
pub use rcc::Reset;
