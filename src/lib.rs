//! mobgate, a multi-port Modbus router.
#![no_std]
#![forbid(unsafe_code)]

pub mod config;
pub mod hal;
pub mod modbus;
pub mod route;
