//! What the firmware of boards with an Ethernet of their own shares; a chip's library adds its drivers and the tasks over them.
//!
//! * [`gateway`]: the gateway's statics and tasks; [`lines`]: the table of lines, which ports open by name.
//! * [`network`]: the stack on the board's Ethernet and its sockets.
//! * [`console`]: the console over any terminal, `ssh`: and by network; `web`: the web interface; [`start`]: the settings at start-up, and the factory reset.
//! * [`system`]: the console's interface to the board; [`watchdog`]: whether it may be fed, shown by the [`lights`]; [`trial`]: whether new
//!   firmware stays; `waiting`: what the next restart starts.
#![no_std]
// The types of the web interface's futures are deep.
#![recursion_limit = "256"]

pub mod console;
pub mod gateway;
pub mod lights;
pub mod lines;
pub mod network;
mod sockets;
// As its feature.
#[cfg(feature = "ssh")]
mod ssh;
pub mod start;
// Images without it are smaller, see Cargo.toml.
#[cfg(feature = "ethercat")]
pub mod states;
pub mod system;
pub mod trial;
// As above: without EtherCAT nothing waits.
#[cfg(feature = "ethercat")]
mod waiting;
pub mod watchdog;
// As its feature.
#[cfg(feature = "web")]
mod web;
