//! The gateway between EtherCAT and Modbus: its configuration by objects, and its process image against devices on a wire.

pub(crate) mod bench;
mod conduct;
mod configuration;
mod controller;
mod diagnosis;
mod drive;
mod exchange;
mod files;
mod firmware;
mod image_table;
mod keeping;
mod lights;
mod line;
mod long_images;
pub(crate) mod matrix;
pub(crate) mod modules;
mod modules_on_a_wire;
mod objects;
mod points;
mod random;
mod requests;
mod silence;
mod start_up_list;
pub(crate) mod virtual_devices;
