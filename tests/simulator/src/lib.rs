//! A world in virtual time around the gateway: RS-485 wires, Modbus devices, TCP, faults.
//!
//! [`World`] polls the gateway's futures and the simulated surroundings in an order drawn from a seed, and leaps
//! from alarm to alarm. The parts themselves use embassy-time only, so they also run on the wall clock (the
//! Linux program's demo does that). [`device`], [`client`] and [`master`] build and check frames by themselves, without the core's
//! codecs, so that one side checks the other.
#![forbid(unsafe_code)]

pub mod client;
pub mod console;
pub mod device;
#[cfg(feature = "masters")] // A MainDevice writes to it.
pub mod drive;
pub mod esc;
pub mod fault;
pub mod flash;
pub mod framing;
pub mod lan9252;
pub mod master;
pub mod net;
pub mod own_network;
pub mod power_cuts;
pub mod random;
pub mod rig;
pub mod serial;
pub mod share;
pub mod shared_bus;
pub mod sub_device;
pub mod timing;
#[cfg(feature = "masters")] // For MainDevices in other programs, and controllers of those.
pub mod wall_clock;
pub mod wire;
pub mod world;

pub use client::Client;
pub use device::Device;
pub use fault::{Fault, Faults};
pub use lan9252::Lan9252;
pub use master::Master;
pub use net::Network;
pub use random::Random;
pub use rig::Rig;
pub use serial::SimSerial;
pub use wire::{LineEnd, Wire};
pub use world::World;
