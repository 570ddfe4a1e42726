//! `mobgate sii` and `mobgate esi`: writes the gateway's description as an EtherCAT SubDevice to a file.

use std::fs;
use std::path::Path;

use ethercat_description::sii;
use mobgate::fieldbus::updatable_device;
use mobgate::settings::Settings;
use mobgate_description::write_esi;

use crate::cli::Make;
use crate::settings;

/// Writes the requested file.
pub fn write(make: &Make) -> Result<(), String> {
    let (file, content) = match make {
        Make::Sii { modules, file } => {
            let mut image = [0; sii::SII_BYTES];
            sii::write(updatable_device(*modules), &mut image).map_err(|error| error.to_string())?;
            (file, image.to_vec())
        }
        Make::Esi { config, file } => {
            let mut xml = String::new();
            let settings = config.as_deref().map_or_else(|| Ok(Settings::default()), settings_in)?;
            let ethernet = settings.ethercat().is_some_and(|port| port.ethernet.is_some());
            write_esi(&settings.slaves, ethernet, &mut xml).map_err(|error| error.to_string())?;
            (file, xml.into_bytes())
        }
    };
    fs::write(file, content).map_err(|error| format!("{}: {error}", file.display()))
}

fn settings_in(file: &Path) -> Result<Settings, String> {
    let named = |error: String| format!("{}: {error}", file.display());
    let text = fs::read_to_string(file).map_err(|error| named(error.to_string()))?;
    settings::parse(&text).map_err(named)
}
