//! The gateway's status as JSON, table by table and row by row: what `show` shows.

use core::fmt::{self, Write};

use heapless::String;

use super::json::{Quoted, Row};
use super::piece::{Piece, Source};
use crate::console::access::{self, PointRow, Show};
use crate::scanner::POINTS;

/// A table of a response: its name there, and its rows; `None`: the data points.
pub(super) type TableOf = (&'static str, Option<Show>);

/// The tables of the status: the last one where there can be data points.
const TABLES: &[TableOf] = ALL.split_at(ALL.len() - !POINTS as usize).0;
const ALL: &[TableOf] = &[
    ("ports", Some(Show::Ports)),
    ("servers", Some(Show::Servers)),
    ("units", Some(Show::Units)),
    ("clients", Some(Show::Clients)),
    ("rules", Some(Show::Routes)),
    ("devices", Some(Show::Devices)),
    ("points", None),
];

/// Fits each heading.
type Heading = String<128>;

/// An object of tables, and how far it has been written.
#[derive(Clone)]
pub(super) struct Status {
    tables: &'static [TableOf],
    /// The next of them.
    table: usize,
    /// The next row; 0 before the table.
    place: usize,
    /// There was a row.
    has_rows: bool,
    is_over: bool,
}

impl Status {
    /// The status.
    pub(super) fn new() -> Self {
        Self::of(TABLES)
    }

    /// Only these tables.
    pub(super) fn of(tables: &'static [TableOf]) -> Self {
        Self { tables, table: 0, place: 0, has_rows: false, is_over: false }
    }

    /// Whether it begins with values outside tables.
    fn has_head(&self) -> bool {
        core::ptr::eq(self.tables, TABLES)
    }

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
        if self.is_new() && self.has_head() {
            head(source, out)?;
        }
        let Some((name, table)) = self.tables.get(self.table) else { return Ok(false) };
        if self.place == 0 {
            let before = if self.is_new() && !self.has_head() { "{" } else { "," };
            write!(out, "{before}\"{name}\":[")?;
            (self.place, self.has_rows) = (1, false);
            return Ok(true);
        }
        let start = out.len();
        if self.has_rows {
            out.write_str(",")?;
        }
        let is_row = match table {
            Some(show) => row(source, *show, self.place, out)?,
            None if POINTS => {
                let row =
                    access::point(source.gateway, self.place - 1, |row| point(&row, out).map(|()| true));
                row.transpose()?
            }
            None => None,
        };
        match is_row {
            Some(true) => self.has_rows = true,
            _ => out.truncate(start),
        }
        self.place += 1;
        if is_row.is_none() {
            (self.table, self.place) = (self.table + 1, 0);
            self.is_over = self.table >= self.tables.len();
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
    let (unsaved, frames) = (gateway.has_unsaved(), gateway.capture().is_some());
    write!(out, "{{\"version\":{},\"unsaved\":{unsaved},\"frames\":{frames}", Quoted(version))?;
    out.write_str(",\"candidate\":")?;
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
    mut out: &mut Piece,
) -> Result<Option<bool>, fmt::Error> {
    let mut heading = Heading::new();
    let Source { gateway, system } = *source;
    access::row(gateway, system, show, 0, &mut heading).transpose()?;
    let mut row = Row::new(&mut out, &heading);
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
