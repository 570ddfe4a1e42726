//! `show version` and `show update`: what runs here, for how long, and whether it is on trial.

use core::fmt;

use embassy_time::Instant;

use super::output::Written;
use super::rows::age;
use super::table::Source;
use crate::fieldbus::EthercatState;
use crate::hal::System;

/// `show version`.
pub(super) fn row(
    source: &Source<'_, '_>,
    system: &dyn System,
    place: usize,
    out: &mut dyn fmt::Write,
) -> Written {
    let Source { gateway, settings, now } = *source;
    let (version, board) = (env!("CARGO_PKG_VERSION"), system.name());
    let up = age(Instant::from_ticks(0), now);
    (place == 0).then(|| {
        write!(out, "mobgate {version} on {board}, up {up}")?;
        gateway.write_time(settings.ntp(), now, out)?;
        if let Some(firmware) = system.firmware() {
            write!(out, ", {firmware}")?;
        }
        let Some(controller) = gateway.ethercat_controller(settings) else { return Ok(()) };
        write!(out, ", {controller}")?;
        let indicators = gateway.ethercat().and_then(EthercatState::indicators);
        indicators.map_or(Ok(()), |indicators| write!(out, ", {indicators}"))
    })
}

/// `show update`.
pub(super) fn update(system: &dyn System, place: usize, out: &mut dyn fmt::Write) -> Written {
    let version = env!("CARGO_PKG_VERSION");
    (place == 0).then(|| match system.firmware() {
        Some(firmware) => write!(out, "{version}: {firmware}"),
        None => write!(out, "{version}, which does not update itself: see update"),
    })
}
