//! Loads data points into the scanner, and determines what new settings change about the existing ones.

use embassy_time::Instant;

use crate::scanner::{Full, Scanner};
use crate::settings::Settings;

/// What new settings change about the existing points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reloaded {
    /// Nothing.
    Nothing,
    /// Others were appended.
    Added,
    /// All restart.
    All,
}

/// Loads the points of `new` into `scanner`, after those of `old`: devices and rows keep the indexes of the settings. Appended
/// points leave the existing ones alone; after any other change all restart.
pub(crate) fn load(
    scanner: &mut Scanner,
    old: &Settings,
    new: &Settings,
    now: Instant,
) -> Result<Reloaded, Full> {
    let added = new.devices.starts_with(&old.devices) && new.points.starts_with(&old.points);
    if added && (new.devices.len(), new.points.len()) == (scanner.devices(), scanner.rows()) {
        return Ok(Reloaded::Nothing);
    }
    let reloaded =
        if added && scanner.devices() + scanner.rows() > 0 { Reloaded::Added } else { Reloaded::All };
    if reloaded == Reloaded::All {
        scanner.restart(now);
    }
    for device in new.devices.iter().skip(scanner.devices()) {
        scanner.add_device(device.device)?;
    }
    for point in new.points.iter().skip(scanner.rows()) {
        let values = scanner.allocate(point.bytes() as u16)?;
        scanner.add_row(point.row(values), now)?;
    }
    Ok(reloaded)
}
