//! `mobgate sii` and `mobgate esi`: the gateway's description as an EtherCAT SubDevice, into a file.

use std::fs;

use ethercat_subdevice::{esi, sii};
use mobgate::port::ethercat::{DEVICE, device};

use crate::cli::Make;

/// Writes the file that was asked for.
pub fn write(make: &Make) -> Result<(), String> {
    let (file, content) = match make {
        Make::Sii { modules, file } => {
            let mut image = [0; sii::SII_BYTES];
            sii::write(device(*modules), &mut image).map_err(|error| error.to_string())?;
            (file, image.to_vec())
        }
        Make::Esi { file } => {
            let mut xml = String::new();
            esi::write(&DEVICE, &mut xml).map_err(|error| error.to_string())?;
            (file, xml.into_bytes())
        }
    };
    fs::write(file, content).map_err(|error| format!("{}: {error}", file.display()))
}
