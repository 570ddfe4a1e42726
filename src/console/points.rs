//! Data points at the console: values, status, and direct reads and writes.

use core::fmt;

use embassy_time::{Duration, Instant};

use super::layout::{self, Columns, Layout};
use super::output::{NO_ROW, Written};
use super::point_ask::{Ask, Cells, parse};
use super::point_command::PointCommand;
use super::point_order::{order, settled};
use super::rows::{LINE_VALUES_MAX, age, text};
use super::session::Session;
use super::table::{Source, titled};
use super::values::Values;
use super::wait::{Begun, Wait, WaitEvent};
use crate::gateway::ApplyError;
use crate::language::Words;
use crate::modbus::crc::crc16;
use crate::scanner::{DeviceId, DeviceStatus, Modicon, RowId, ScannerState, Writing};
use crate::settings::{POINTS_MAX, PointAt, PointSettings, Settings, Time};

/// Time limit of a command.
const PATIENCE: Duration = Duration::from_secs(5);
/// Polling interval of a command.
const POLL: Duration = Duration::from_millis(10);
/// Polling interval of `watch`.
const WATCH: Duration = Duration::from_millis(100);
const POINTS: &str = "POINT\tWHERE\tTABLE\tWIRE\tMODICON\tSTATUS; VALUES";
const DEVICES: &str = "DEVICE\tUNIT\tREQUESTS\tRESPONSES\tEXCEPTIONS\tFAILURES\tHEARD\tSTATE";
/// Columns of the tables without the last ones.
pub(super) const COLUMNS: Columns = &[15, 15, 8, -6, -7];
pub(super) const DEVICE_COLUMNS: Columns = &[15, -4, -10, -10, -10, -10, -9];

/// Shows points.
// One per session.
#[allow(clippy::large_enum_variant)]
pub(super) enum PointJob {
    /// One point, from a line on, once its command is done or timed out.
    One { row: RowId, until: Option<Instant>, line: usize },
    /// Changed points: what was last shown of each, and the current point, from a line on.
    Changing { shown: [Option<(u16, u16)>; POINTS_MAX], at: usize, line: usize },
}

impl Session<'_, '_> {
    /// Runs `command` with its words.
    pub(super) fn point(&mut self, command: PointCommand, words: &Words<'_>) -> Begun<PointJob> {
        let Some(state) = self.gateway.scanner() else {
            return Ok((None, self.fail(&ApplyError::NoPoints)));
        };
        let mut cells = Cells::new();
        let ask = self.gateway.settings(|settings| parse(settings, command, words, &mut cells))?;
        let now = Instant::now();
        if let Err(refused) = state.change(|scanner| order(scanner, command, &ask, &cells, now)) {
            return Ok((None, self.fail(&refused)));
        }
        Ok(match (ask, command) {
            (Ask::Range { .. }, _) | (_, PointCommand::Begin | PointCommand::Mark) => (None, Wait::End),
            (Ask::Row(row) | Ask::Put { row, .. }, _) => {
                (Some(PointJob::One { row, until: Some(now + PATIENCE), line: 0 }), Wait::Sent)
            }
        })
    }

    /// `watch points`: all points, then those whose status or values change, until a key is typed.
    pub(super) fn watch_points(&mut self) -> Begun<PointJob> {
        Ok((Some(PointJob::Changing { shown: [None; POINTS_MAX], at: 0, line: 0 }), Wait::Sent))
    }
}

impl PointJob {
    /// Runs the next step after `event`.
    pub(super) fn step(&mut self, session: &mut Session<'_, '_>, event: WaitEvent) -> Wait {
        let Some(state) = session.gateway.scanner() else { return session.fail(&ApplyError::NoPoints) };
        match self {
            Self::One { row, until, line } => {
                if let Some(give_up) = *until {
                    match settled(state, *row, give_up) {
                        None => return Wait::Rest(POLL),
                        Some(true) => {}
                        Some(false) => {
                            session.out.line(format_args!("it is not done yet: see show points"));
                        }
                    }
                    *until = None;
                }
                lines_of(session, state, *row, line, usize::MAX)
            }
            Self::Changing { .. } if matches!(event, WaitEvent::Typed(_)) => Wait::End,
            Self::Changing { shown, at, line } => {
                let points = session.gateway.settings(|settings| settings.points.len());
                while let Some(shown) = shown.get_mut(*at).filter(|_| *at < points) {
                    let id = RowId(*at as u8);
                    let now = state.with(|scanner| {
                        (scanner.status(id, Instant::now()).bits(), crc16(scanner.input(id)))
                    });
                    let changed = *line > 0 || shown.replace(now) != Some(now);
                    if changed && let Wait::Sent = lines_of(session, state, id, line, LINE_VALUES_MAX) {
                        return Wait::Sent;
                    }
                    *line = 0;
                    *at += 1;
                }
                *at = 0;
                Wait::Pause(WATCH)
            }
        }
    }
}

/// Shows the next line of a point with at most `most` values.
fn lines_of(
    session: &mut Session<'_, '_>,
    state: &ScannerState,
    id: RowId,
    line: &mut usize,
    most: usize,
) -> Wait {
    let (gateway, now) = (session.gateway, Instant::now());
    let layout = Layout::fixed(COLUMNS);
    layout::row(&mut session.out, &layout, line, &mut |line, out| {
        gateway.settings(|settings| point(settings, state, id, (line, most), now, out))
    })
}

/// `show points`: two lines each; the second has as many values as fit.
pub(super) fn row(source: &Source<'_, '_>, place: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, now } = *source;
    titled(POINTS, place, out, |nth, out| {
        let (scanner, id) = (gateway.scanner()?, RowId(u8::try_from(nth / 2).ok()?));
        settings.points.get(usize::from(id.0))?;
        point(settings, scanner, id, (nth % 2, LINE_VALUES_MAX), now, out).or(NO_ROW)
    })
}

/// Line `line` of a point with at most `most` values.
fn point(
    settings: &Settings,
    state: &ScannerState,
    id: RowId,
    (line, most): (usize, usize),
    now: Instant,
    out: &mut dyn fmt::Write,
) -> Written {
    let point = settings.points.get(usize::from(id.0))?;
    let Some(row) = line.checked_sub(1) else {
        return Some(head(settings, state, id, point, now, out));
    };
    let (all, at) = (usize::from(point.count), row * LINE_VALUES_MAX);
    let count = all.min(most);
    let shown = count.checked_sub(at).filter(|shown| *shown > 0)?.min(LINE_VALUES_MAX);
    let more = if at + shown < all && at + shown == count { " ..." } else { "" };
    Some(state.with(|scanner| {
        let PointSettings { value, scale, .. } = *point;
        let values = Values { value, scale, cells: scanner.input(id), range: at..at + shown };
        write!(out, "  [{at}]{values}{more}")
    }))
}

/// The line above a point's values.
fn head(
    settings: &Settings,
    state: &ScannerState,
    id: RowId,
    point: &PointSettings,
    now: Instant,
    out: &mut dyn fmt::Write,
) -> fmt::Result {
    let (status, fresh) = state.with(|scanner| (scanner.status(id, now), scanner.age(id, now)));
    let whence = match point.at {
        PointAt::Device { device, .. } => settings.device_name(device),
        PointAt::Local { .. } => "local",
    };
    let modicon = text(format_args!("{}", Modicon(point.kind, point.first)));
    let old = match fresh {
        Some(fresh) => text(format_args!("{}.{}s old", fresh.as_secs(), fresh.as_millis() / 100 % 10)),
        None => text(format_args!("never read")),
    };
    let label = &point.label;
    let wire = match point.at {
        PointAt::Device { bits: Some(bits), .. } => text(format_args!("{}.{bits}", point.first)),
        _ => text(format_args!("{}", point.first)),
    };
    write!(
        out,
        "{}\t{whence}\t{}\t{wire}\t{modicon}\t{:04X}h {status}; {old}; ",
        point.name,
        point.kind,
        status.bits()
    )?;
    if let PointAt::Device { write: Writing::Every(period), .. } = point.at {
        let is_written = state.with(|scanner| scanner.is_written_again(id));
        let once = if is_written { "" } else { ", once written" };
        write!(out, "written every {}{once}; ", Time(period.duration()))?;
    }
    write!(out, "{label}")
}

/// `show devices`: devices of data points, then those of the EtherCAT process image.
pub(super) fn device(source: &Source<'_, '_>, place: usize, out: &mut dyn fmt::Write) -> Written {
    titled(DEVICES, place, out, |nth, out| device_row(source, nth, out))
}

fn device_row(source: &Source<'_, '_>, row: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, now } = *source;
    if let Some(device) = settings.devices.get(row) {
        let status = gateway.scanner()?.with(|scanner| scanner.device_status(DeviceId(row as u8), now))?;
        let (name, unit) = (&device.name, device.device.unit);
        return Some(write!(out, "{}", DeviceRow { name, unit, status: &status, inputs: "", now }));
    }
    let nth = row - settings.devices.len();
    let slave = settings.slaves.get(nth)?;
    let status = gateway.ethercat()?.slave_status(nth)?;
    let inputs = if status.alive == Some(false) { slave.on_silence.of_inputs() } else { "" };
    let name = text(format_args!("slave {nth}"));
    Some(write!(out, "{}", DeviceRow { name: &name, unit: slave.unit, status: &status, inputs, now }))
}

/// A polled device and its status.
struct DeviceRow<'s> {
    name: &'s str,
    unit: u8,
    status: &'s DeviceStatus,
    /// The content of its inputs, if it is not the values read.
    inputs: &'static str,
    now: Instant,
}

impl fmt::Display for DeviceRow<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, unit, status, inputs, now } = self;
        let DeviceStatus { requests, responses, exceptions, failures, .. } = status;
        let heard =
            if *responses == 0 { text(format_args!("never")) } else { age(status.last_response, *now) };
        write!(f, "{name}\t{unit}\t{requests}\t{responses}\t{exceptions}\t{failures}\t{heard}\t")?;
        f.write_str(match status.alive {
            None => "not asked yet",
            Some(true) => "alive",
            Some(false) => "silent",
        })?;
        f.write_str(inputs)?;
        if let Some(until) = status.backs_off_until {
            write!(f, ", tried again in {}s", (until - *now).as_secs() + 1)?;
        }
        match status.error {
            Some(error) => write!(f, ", last error: {}", error.name()),
            None => Ok(()),
        }
    }
}
