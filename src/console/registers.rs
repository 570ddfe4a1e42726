//! `show registers`: what stands in which register of the gateway's own unit. README.md says what each of them means.

use core::fmt;

use super::output::{NO_ROW, Written};
use super::show::{Source, titled};
use crate::config::PORTS_MAX;
use crate::port::local::{image, points, table};
use crate::port::units::UNITS_MAX;
use crate::scanner::REQUESTERS;

const HEADING: &str = "REGISTERS       TABLE         WHAT";
/// Rows of what a board with EtherCAT has.
const IMAGE: [(u16, &str); 3] = [
    (image::INPUTS, "process image: inputs"),
    (image::OUTPUTS, "process image: outputs"),
    (image::SLAVES, "state and age of slave 0, and so on"),
];

/// The gateway's, those of each port, of the process image and of the points.
pub(super) fn row(source: &Source<'_, '_>, place: usize, out: &mut dyn fmt::Write) -> Written {
    titled(HEADING, place, out, |nth, out| match nth.checked_sub(1) {
        None => Some(write!(out, "{:04X}h           input         the gateway", table::BASE)),
        Some(port @ 0..PORTS_MAX) => port_row(source, port, out),
        Some(nth) => image_row(source, nth - PORTS_MAX, out),
    })
}

fn port_row(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Some(Some((port, _))) = source.port(nth) else { return NO_ROW };
    let first = table::PORTS + nth as u16 * table::PORT_LENGTH;
    let units = table::UNITS + (nth * UNITS_MAX) as u16 * table::UNIT_LENGTH;
    Some(write!(out, "{first:04X}h, {units:04X}h    input         port {}, its units", port.name))
}

fn image_row(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Some((first, what)) = IMAGE.get(nth) else { return point_row(source, nth - IMAGE.len(), out) };
    if source.gateway.ethercat().is_none() {
        return NO_ROW;
    }
    Some(write!(out, "{first:04X}h           input         {what}"))
}

fn point_row(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    source.gateway.scanner()?;
    if let Some(point) = source.settings.points.get(nth) {
        let (first, name) = (points::POINTS + nth as u16, &point.name);
        return Some(write!(
            out,
            "{first:04X}h           holding       point {name}: command (input: status)"
        ));
    }
    Some(match nth - source.settings.points.len() {
        0 => write!(
            out,
            "{:04X}h-{:04X}h     holding       points of a range: requester and device, function, first, count",
            points::RANGE,
            points::RANGE + 3
        ),
        1 => write!(
            out,
            "{:04X}h-{:04X}h     holding       commands of requester 0, and so on: under way, failed",
            points::COMMANDS,
            points::COMMANDS + u16::from(REQUESTERS) - 1
        ),
        _ => return None,
    })
}
