//! Describes a SubDevice to MainDevices and configuration tools. Generates the controller's EEPROM ([`sii`]) and the description
//! file ([`esi`]) on a host, from the table that also serves SDO.
//!
//! ```
//! use ethercat_description::{esi, sii};
//! use ethercat_subdevice::device::Device;
//!
//! fn describe(device: &Device) -> Result<([u8; sii::SII_BYTES], String), esi::EsiError> {
//!     let (mut image, mut file) = ([0; sii::SII_BYTES], String::new());
//!     sii::write(device, &mut image)?;
//!     esi::write(device, &mut file)?;
//!     Ok((image, file))
//! }
//! ```
#![forbid(unsafe_code)]

pub mod esi;
pub mod sii;
