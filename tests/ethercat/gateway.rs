//! The gateway between EtherCAT and Modbus: its configuration by objects, and its process image against devices on a wire.

mod bench;
mod conduct;
mod configuration;
mod exchange;
mod objects;
mod random;
mod virtual_devices;
