//! The gateway as an EtherCAT SubDevice: what a MainDevice sees of it. Modbus is not behind it yet.
//!
//! A MainDevice writes which devices there are (2000h to 2020h) and sets 2005h:01. The configuration is then checked as a whole,
//! the layout of both buffers is computed (2011h to 2014h), and 2005h:02 says that it is in use, until the MainDevice resets it.

mod application;
mod layout;
mod objects;

pub use application::GatewayObjects;
pub use layout::{DeviceLayout, DeviceSettings, Kind, KindSettings, LayoutError};
pub use objects::{DEVICE, IMAGE_BYTES, MODBUS_DEVICES_MAX};
