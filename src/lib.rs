//! mobgate, a multi-port Modbus router.
#![no_std]
#![forbid(unsafe_code)]

#[macro_use]
mod fmt;

pub mod config;
pub mod console;
pub mod frame;
pub mod gateway;
pub mod hal;
pub mod modbus;
pub mod port;
pub mod route;
mod router;
pub mod stats;
