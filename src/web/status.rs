//! The gateway's status as JSON, table by table and row by row: what `show` shows.

use core::fmt::{self, Write};

use heapless::String;

use super::json::{Quoted, Row};
use super::piece::{Piece, Source};
use crate::console::access::{self, PointRow, Show};

/// The tables by name.
const TABLES: &[(&str, Show)] = &[
    ("ports", Show::Ports),
    ("servers", Show::Servers),
    ("units", Show::Units),
    ("clients", Show::Clients),
    ("rules", Show::Routes),
    ("devices", Show::Devices),
];

/// Fits each heading.
type Heading = String<128>;

/// How far the status has been written.
#[derive(Default)]
pub(super) struct Status {
    /// Of [`TABLES`]; behind them, the points.
    table: usize,
    /// The next row; 0 before the table.
    place: usize,
    /// There was a row.
    has_rows: bool,
    is_over: bool,
}

impl Status {
    /// Whether nothing has been written.
    pub(super) fn is_new(&self) -> bool {
        (self.table, self.place) == (0, 0)
    }

    /// Whether the piece written last was the last one.
    pub(super) fn has_just_ended(&self) -> bool {
        self.is_over
    }

    /// Writes the next piece; `false`: there was none.
    pub(super) fn next(&mut self, source: &Source<'_, '_>, out: &mut Piece) -> Result<bool, fmt::Error> {
        if self.is_over {
            return Ok(false);
        }
        if self.is_new() {
            head(source, out)?;
        }
        let table = TABLES.get(self.table);
        if self.place == 0 {
            write!(out, ",\"{}\":[", table.map_or("points", |(name, _)| name))?;
            (self.place, self.has_rows) = (1, false);
            return Ok(true);
        }
        let start = out.len();
        if self.has_rows {
            out.write_str(",")?;
        }
        let is_row = match table {
            Some((_, show)) => row(source, *show, self.place, out)?,
            None => access::point(source.gateway, self.place - 1, |row| point(&row, out).map(|()| true))
                .transpose()?,
        };
        match is_row {
            Some(true) => self.has_rows = true,
            _ => out.truncate(start),
        }
        self.place += 1;
        if is_row.is_none() {
            (self.table, self.place) = (self.table + 1, 0);
            self.is_over = table.is_none();
            out.write_str(if self.is_over { "]}" } else { "]" })?;
        }
        Ok(true)
    }
}

/// The beginning of the object.
fn head(source: &Source<'_, '_>, out: &mut Piece) -> fmt::Result {
    let gateway = source.gateway;
    let mut version = String::<256>::new();
    // A longer text is cut.
    let _ = access::row(gateway, source.system, Show::Version, 0, &mut version);
    let unsaved = gateway.has_unsaved();
    write!(out, "{{\"version\":{},\"unsaved\":{unsaved},\"candidate\":", Quoted(version))?;
    let candidate = gateway.candidate();
    match candidate.and_then(|candidate| candidate.remaining(embassy_time::Instant::now())) {
        Some(left) => write!(out, "\"waiting\",\"remaining_s\":{}", left.as_secs()),
        None if candidate.is_some_and(|candidate| candidate.is_open()) => out.write_str("\"open\""),
        None => out.write_str("\"none\""),
    }
}

/// The row at `place` of a table; `None` behind the last one, `Some(false)` if there is none at this place.
fn row(
    source: &Source<'_, '_>,
    show: Show,
    place: usize,
    out: &mut Piece,
) -> Result<Option<bool>, fmt::Error> {
    let mut heading = Heading::new();
    let Source { gateway, system } = *source;
    access::row(gateway, system, show, 0, &mut heading).transpose()?;
    let mut row = Row::new(out, &heading);
    match access::row(gateway, system, show, place, &mut row).transpose()? {
        Some(()) => row.finish().map(Some),
        None => Ok(None),
    }
}

fn point(row: &PointRow<'_>, out: &mut Piece) -> fmt::Result {
    let PointRow { name, device, table, address, status, age, label, values } = row;
    write!(out, "{{\"name\":{},\"device\":{},\"table\":{}", Quoted(name), Quoted(device), Quoted(table))?;
    write!(out, ",\"address\":{address},\"status\":{},\"age_s\":", Quoted(status))?;
    match age {
        Some(age) => write!(out, "{}.{}", age.as_secs(), age.as_millis() / 100 % 10)?,
        None => out.write_str("null")?,
    }
    write!(out, ",\"label\":{},\"values\":{values}}}", Quoted(label))
}
