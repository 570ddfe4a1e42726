//! Texts in the rows of tables.

use core::fmt;

use embassy_time::{Duration, Instant};
use heapless::String;

use crate::capture::FrameKind;
use crate::gateway::unit_health::{State, Unit};
use crate::gateway::{Gateway, Status};
use crate::routing::is_implied;
use crate::settings::{DEVICE_BYTES_MAX, Policy, PortId, Route, Settings, Time};
use crate::stats::{LogEntry, Outcome};

/// The longest cell: a device, or an IPv6 address with its port.
const CELL_BYTES_MAX: usize = if DEVICE_BYTES_MAX > 64 { DEVICE_BYTES_MAX } else { 64 };

/// The text of a cell.
pub(super) type Cell = String<CELL_BYTES_MAX>;

/// Text that is padded as a whole.
pub(super) fn text(content: fmt::Arguments<'_>) -> Cell {
    let mut text = Cell::new();
    // Longer text is truncated.
    let _ = fmt::Write::write_fmt(&mut text, content);
    text
}

/// [`text`] of one value.
pub(super) fn cell(content: &dyn fmt::Display) -> Cell {
    text(format_args!("{content}"))
}

/// The name of `port`, without access to the settings.
pub(super) fn port_name(gateway: &Gateway<'_>, port: PortId) -> Cell {
    gateway.settings(|settings| text(format_args!("{}", settings.name(port))))
}

/// Values in a line of output.
pub(super) const LINE_VALUES_MAX: usize = 8;

/// The time since `then` in whole seconds.
pub(super) fn age(then: Instant, now: Instant) -> Cell {
    text(format_args!("{}s", now.saturating_duration_since(then).as_secs()))
}

/// A time in microseconds, or `-`.
pub(super) fn took(us: Option<u32>) -> Cell {
    match us {
        Some(us) => text(format_args!("{}", Time(Duration::from_micros(us.into())))),
        None => text(format_args!("-")),
    }
}

/// The errors of a unit, named like the port's counters.
pub(super) struct LineErrors<'u>(pub(super) &'u Unit);

impl fmt::Display for LineErrors<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, (event, count)) in self.0.errors().enumerate() {
            write!(f, "{}{count} {}", if at > 0 { ", " } else { "" }, event.name())?;
        }
        Ok(())
    }
}

/// The state of a unit, and advice.
pub(super) fn describe_unit(unit: &Unit, state: State) -> (&'static str, &'static str) {
    let state = match state {
        State::Up => "up",
        State::OutOfStep => "out-of-step",
        State::Held => "held",
        State::Down => "down",
    };
    let advice = match unit {
        _ if unit.is_slow() => "slower than its time-out: tune",
        Unit { unproven: true, .. } => "unproven",
        _ => "",
    };
    (state, advice)
}

pub(super) struct StatusText(pub(super) Status);

impl fmt::Display for StatusText {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Status::Off => f.write_str("off"),
            Status::Open => f.write_str("open"),
            Status::Idle => f.write_str("idle, connects when asked"),
            Status::Waiting => f.write_str("waits for its device"),
            Status::Lost => f.write_str("lost, is opened again"),
            Status::Failed(error) => write!(f, "{error}"),
        }
    }
}

/// The bytes of a frame: hexadecimal, or the characters themselves.
pub(super) struct Bytes<'b> {
    pub(super) kind: FrameKind,
    pub(super) bytes: &'b [u8],
}

impl fmt::Display for Bytes<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.bytes.iter().try_for_each(|&byte| match self.kind {
            FrameKind::Ascii => write!(f, "{}", byte.escape_ascii()),
            FrameKind::Rtu | FrameKind::Tcp | FrameKind::Udp => write!(f, "{byte:02X} "),
        })
    }
}

pub(super) struct Row<'s> {
    pub(super) settings: &'s Settings,
    pub(super) route: &'s Route,
}

impl fmt::Display for Row<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { settings, route } = self;
        let kind = if is_implied(settings, route) { "implied" } else { "rule" };
        let (source, destination) = (settings.name(route.source), settings.destination(route.destination));
        write!(f, "{source}\t{}\t", route.units)?;
        match route.peer {
            Some(peer) => write!(f, "{peer}"),
            None => f.write_str("*"),
        }?;
        write!(f, "\t{}\t{destination}\t", route.tag)?;
        let everything = if route.policy == Policy::default() { "all" } else { "" };
        write!(f, "{kind}\t{everything}{}", route.policy)
    }
}

pub(super) struct LogRow<'s> {
    pub(super) settings: &'s Settings,
    pub(super) entry: LogEntry,
}

impl fmt::Display for LogRow<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { settings, entry } = self;
        let LogEntry { unit, target, function, .. } = entry;
        let name = |id: PortId| settings.name(id);
        let took = Time(Duration::from_micros(entry.took_us.into()));
        let (source, destination) = (name(entry.source), entry.destination.map_or("-", name));
        write!(f, "{source}\t{unit}\t{destination}\t{target}\t{function}\t{took}\t")?;
        match entry.outcome {
            Outcome::Response => f.write_str("response"),
            Outcome::Exception(exception) => write!(f, "{exception}"),
            Outcome::Silence => f.write_str("no response due"),
            Outcome::RequesterGone => f.write_str("requester gone"),
        }
    }
}

const _: () = assert!(crate::settings::NAME_BYTES_MAX == 15, "the width of port columns");
