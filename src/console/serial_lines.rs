//! `show lines`: the serial lines of this machine, and the ports that have them.

use core::fmt;

use heapless::String;

use super::output::{NO_ROW, Written};
use super::table::Source;
use crate::hal::System;
use crate::settings::{DEVICE_BYTES_MAX, PortKind};

pub(super) const HEAD: &str = "LINE\tPORT";

/// Line `nth`, as ports open it.
pub(super) fn row(
    source: &Source<'_, '_>,
    system: &dyn System,
    nth: usize,
    out: &mut dyn fmt::Write,
) -> Written {
    let mut line = String::<DEVICE_BYTES_MAX>::new();
    if system.write_serial_line(nth, &mut line)?.is_err() {
        return NO_ROW; // longer than a setting can be
    }
    let port = source.settings.ports.iter().flatten().find(|port| match &port.kind {
        PortKind::Serial(serial) => source.gateway.is_same_device(&serial.device, &line),
        _ => false,
    });
    Some(write!(out, "{line}\t{}", port.map_or("-", |port| &port.name)))
}
