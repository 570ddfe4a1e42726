//! The gateway between EtherCAT and Modbus: its configuration by objects, and its process image against devices on a wire.

mod bench;
mod conduct;
mod configuration;
mod controller;
mod exchange;
mod keeping;
mod line;
mod long_images;
mod objects;
mod random;
mod requests;
mod silence;
mod virtual_devices;
