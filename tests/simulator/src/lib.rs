//! A world in virtual time around the gateway: RS-485 wires, Modbus devices, TCP, faults.
//!
//! [`World`] polls the gateway's futures and the simulated surroundings in an order drawn from a seed, and leaps
//! from alarm to alarm. The parts themselves use embassy-time only, so they also run on the wall clock (the
//! Linux program's demo does that). [`device`], [`client`] and [`master`] build and check frames by themselves, without the core's
//! codecs, so that one side checks the other.
//!
//! The world is the crate `mobgate-world`, EtherCAT controllers and what is around them are `ethercat-esc`; both are here as well.
#![forbid(unsafe_code)]

pub mod broker;
pub mod client;
pub mod console;
pub mod device;
#[cfg(feature = "masters")] // A MainDevice writes to it.
pub mod drive;
pub mod fault;
pub mod firmware;
pub mod flash;
pub mod framing;
pub mod master;
pub mod net;
pub mod own_network;
pub mod ports;
pub mod power_cuts;
pub mod rig;
pub mod serial;
pub mod share;
pub mod shared_bus;
pub mod sparkplug;
pub mod timing;
pub mod waiting;
pub mod wire;
pub mod ymodem;

pub use client::Client;
pub use device::Device;
pub use ethercat_esc::{self as esc, Lan9252, lan9252, sub_device};
pub use fault::{Fault, Faults};
pub use master::Master;
#[cfg(feature = "masters")] // For MainDevices in other programs, and controllers of those.
pub use mobgate_world::wall_clock;
pub use mobgate_world::{Random, World, random, world};
pub use net::Network;
pub use rig::Rig;
pub use serial::SimSerial;
pub use wire::{LineEnd, Wire};
