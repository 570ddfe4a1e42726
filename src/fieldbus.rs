//! The gateway as an EtherCAT SubDevice: its objects for a MainDevice, and the mapping of its process image to Modbus devices.
//!
//! A MainDevice writes the configuration of the devices (2000h and following), and sets 2005h:01. The configuration is then checked
//! as a whole, the layout of both buffers is computed (2011h and following), and 2005h:02 indicates that it is in use, until the
//! MainDevice resets it or, in PreOp, writes another one. While it is in use, the port with the keyword `ethercat` polls the
//! devices through the router, by the rules for its name. The devices are also settings: they can be typed and saved, and are in
//! use after the next start.

mod application;
mod chip;
mod config_error;
mod configuration;
mod controller;
mod diagnosis;
mod files;
mod image;
mod keeping;
mod layout;
mod lights;
mod line;
mod modular;
mod modules;
mod objects;
mod points;
mod ranges;
mod request;
mod room;
mod saving;
mod shared;
mod slaves;
mod slots;
mod status;
mod texts;

#[doc(hidden)] // Public for tests/ only.
pub use application::GatewayObjects;
pub use chip::Controller;
pub use config_error::ConfigError;
#[doc(hidden)] // Public for tests/ only.
pub use configuration::Configuration;
#[cfg(feature = "long-images")] // Requires the memory of that feature.
pub use controller::{LongSubDevice, long_device, serve_long};
pub use controller::{device, serve, updatable_device};
#[cfg(feature = "files")] // As what serves them.
pub(crate) use files::File;
pub use files::{FileBuffer, GatewayFiles};
pub(crate) use files::{Owner, Packet, Work};
#[doc(hidden)] // Public for tests/ only.
pub use keeping::Keep;
#[doc(hidden)] // Public for tests/ only.
pub use layout::DeviceLayout;
#[doc(hidden)] // Public for tests/ only.
pub use line::{LineWriter, Speed};
#[doc(hidden)] // Public for tests/ only.
pub use modular::MODULAR;
pub use modular::{LONG_MODULAR, Module};
#[doc(hidden)] // Public for tests/ only.
pub use objects::REASON_BYTES;
pub use objects::{DEVICE, LONG_DEVICE};
#[doc(hidden)] // Public for tests/ only.
pub use request::{REQUEST_BYTES_MAX, RequestState, Requests};
pub use room::Room;
pub use shared::EthercatState;
