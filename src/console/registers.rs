//! `show registers`: the register map of the gateway's own unit; docs/registers.md explains the registers.

use core::fmt;

use super::output::{NO_ROW, Written};
use super::table::{Source, titled};
use crate::port::local::{image, points, table};
use crate::scanner::POINTS;
use crate::settings::PORTS_MAX;

/// First register, table, content, and owner.
type Line<'s> = (u16, &'static str, &'static str, &'s str);

/// Registers of the gateway.
const GATEWAY: Line = (table::BASE, "input", "gateway", "");
/// Registers of EtherCAT.
const IMAGE: [Line; 3] = [
    (image::INPUTS, "input", "process image: inputs", ""),
    (image::OUTPUTS, "input", "process image: outputs", ""),
    (image::SLAVES, "input", "process image: slaves", ""),
];
/// Registers common to all points.
const COMMANDS: [Line; 2] = [
    (points::RANGE, "holding", "range of points: requester and device, function, first, count", ""),
    (points::COMMANDS, "holding", "commands by requester: under way, failed", ""),
];

/// Left out on boards without data points, to save flash.
pub(super) fn row(source: &Source<'_, '_>, place: usize, out: &mut dyn fmt::Write) -> Written {
    if !POINTS {
        return None;
    }
    titled("FIRST\tTABLE\tWHAT", place, out, |nth, out| {
        let Some((first, table, what, whose)) = line(source, nth)? else { return NO_ROW };
        Some(write!(out, "{first:04X}h\t{table}\t{what}{whose}"))
    })
}

/// Line `nth`: `None` after the last one, `Some(None)` for one without content.
fn line<'s>(source: &Source<'s, '_>, nth: usize) -> Option<Option<Line<'s>>> {
    let Some(nth) = nth.checked_sub(1) else { return Some(Some(GATEWAY)) };
    let Some(nth) = nth.checked_sub(2 * PORTS_MAX) else {
        let (port, is_units) = (nth / 2, nth % 2 == 1);
        let name = source.settings.ports.get(port)?.as_ref().map(|port| &*port.name);
        let (first, what) = match is_units {
            false => (table::PORTS + port as u16 * table::PORT_LENGTH, "port "),
            true => {
                (table::UNITS + (port * table::UNITS_PER_PORT) as u16 * table::UNIT_LENGTH, "units of port ")
            }
        };
        return Some(name.map(|name| (first, "input", what, name)));
    };
    let Some(nth) = nth.checked_sub(IMAGE.len()) else {
        return Some(IMAGE.get(nth).copied().filter(|_| source.gateway.ethercat().is_some()));
    };
    source.gateway.scanner()?;
    let Some(nth) = nth.checked_sub(COMMANDS.len()) else { return Some(COMMANDS.get(nth).copied()) };
    let name = &source.settings.points.get(nth)?.name;
    Some(Some((points::POINTS + nth as u16, "holding", "command (input: status) of point ", name)))
}
