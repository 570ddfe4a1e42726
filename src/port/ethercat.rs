//! The gateway as an EtherCAT SubDevice: what a MainDevice sees of it, and how its process image meets the Modbus devices.
//!
//! A MainDevice writes which devices there are (2000h to 2020h) and sets 2005h:01. The configuration is then checked as a whole,
//! the layout of both buffers is computed (2011h to 2014h), and 2005h:02 says that it is in use, until the MainDevice resets it.
//! While it is, the port that the settings call `ethercat` asks the devices through the router, by the rules for its name.

mod application;
mod configuration;
mod controller;
mod layout;
mod objects;
mod place;

pub use application::GatewayObjects;
pub use configuration::{ConfigError, Configuration, Plan, Speed};
pub use controller::{Controller, serve};
pub use layout::{DeviceLayout, DeviceSettings, KindSettings};
pub use objects::{DEVICE, IMAGE_BYTES, MODBUS_DEVICES_MAX, REASON_BYTES};
pub use place::EthercatPlace;
