//! The gateway between EtherCAT and Modbus: its configuration by objects, and its process image against devices on a wire.

pub(crate) mod bench;
mod conduct;
mod configuration;
mod drive;
mod exchange;
pub(crate) mod matrix;
pub(crate) mod virtual_devices;
