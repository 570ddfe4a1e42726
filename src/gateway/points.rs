//! Data points as the rows of a scanner, and what new settings do to those that there are.

use embassy_time::Instant;

use crate::scanner::{Full, Scanner};
use crate::settings::Settings;

/// What new settings have done to the points that were there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reloaded {
    /// They are the same.
    Nothing,
    /// Others came behind them.
    Added,
    /// All begin anew.
    All,
}

/// Makes `scanner` ask for the points of `new`, where `old` has been in force: a device is a device there, and a point is
/// the row at the same place. Points that are added behind the others leave those as they are; after any other change all
/// begin anew.
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
