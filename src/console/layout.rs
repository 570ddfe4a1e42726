//! Lays out tables in columns as wide as their cells.
//!
//! A row is written as cells separated by tabs; the last cell is a text of any length. Piped output has columns of fixed minimum
//! widths. On a terminal too narrow for these, columns are as wide as their cells; what still does not fit continues in the next
//! line, at the same column in each row.

use core::fmt;

use super::output::{Output, Written};
use super::rows::Cell;
use super::wait::Wait;

/// Columns of a table without the last one.
const COLUMNS_MAX: usize = 10;
/// Minimum width of the last cell.
const LAST_MIN: usize = 12;

/// Minimum widths of the columns without the last one; negative: right-aligned.
pub(super) type Columns = &'static [i8];

/// The computed widths.
#[derive(Clone, Copy)]
pub(super) struct Layout {
    columns: Columns,
    widths: [u8; COLUMNS_MAX],
}

impl Layout {
    /// For unknown cells, or lines that are not rows.
    pub(super) fn fixed(columns: Columns) -> Self {
        let mut layout = Self { columns, widths: [0; COLUMNS_MAX] };
        layout.widen();
        layout
    }

    /// For the rows that `write` gives, within `room` columns.
    pub(super) fn of(
        columns: Columns,
        room: Option<usize>,
        write: &mut dyn FnMut(usize, &mut dyn fmt::Write) -> Written,
    ) -> Self {
        let mut measured = Self { columns, widths: [0; COLUMNS_MAX] };
        if columns.is_empty() {
            return measured;
        }
        let mut place = 0;
        while write(place, &mut Measure { at: 0, count: 0, layout: &mut measured }).is_some() {
            place += 1;
        }
        let mut wide = measured;
        wide.widen();
        match room {
            Some(room) if wide.columns_in_all() + LAST_MIN > room => measured,
            _ => wide,
        }
    }

    fn widen(&mut self) {
        for (width, column) in self.widths.iter_mut().zip(self.columns) {
            *width = (*width).max(column.unsigned_abs());
        }
    }

    fn columns_in_all(&self) -> usize {
        self.widths.iter().take(self.columns.len()).map(|width| usize::from(*width) + 1).sum()
    }
}

/// Measures cells.
struct Measure<'l> {
    at: usize,
    count: usize,
    layout: &'l mut Layout,
}

impl fmt::Write for Measure<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for (nth, part) in text.split('\t').enumerate() {
            if nth > 0 {
                let count = u8::try_from(self.count).unwrap_or(u8::MAX);
                self.layout
                    .widths
                    .iter_mut()
                    .skip(self.at)
                    .take(1)
                    .for_each(|width| *width = (*width).max(count));
                self.at += 1;
                self.count = 0;
            }
            self.count += part.chars().count();
        }
        Ok(())
    }
}

/// Writes cells into their columns.
struct Cells<'o> {
    out: &'o mut Output,
    layout: &'o Layout,
    at: usize,
    /// The cell so far; text without a tab is not a cell.
    cell: Cell,
}

impl Cells<'_> {
    /// The cell has ended.
    fn put(&mut self) {
        let Some((column, width)) = self.layout.columns.get(self.at).zip(self.layout.widths.get(self.at))
        else {
            return;
        };
        let width = usize::from(*width);
        if self.at > 0 && !self.out.has_room(width) {
            self.out.indent();
        }
        let cell = &self.cell;
        if *column < 0 {
            self.out.put(format_args!("{cell:>width$} "));
        } else {
            self.out.put(format_args!("{cell:width$} "));
        }
        self.cell.clear();
        self.at += 1;
        // The last cell is not buffered: it may be long.
        if self.at == self.layout.columns.len() && !self.out.has_room(LAST_MIN) {
            self.out.indent();
        }
    }
}

impl fmt::Write for Cells<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for (nth, part) in text.split('\t').enumerate() {
            if nth > 0 {
                self.put();
            }
            if self.at >= self.layout.columns.len() {
                // Lists of options begin with a blank.
                let part =
                    if self.at > 0 && self.out.text.ends_with(' ') { part.trim_ascii_start() } else { part };
                self.out.put(format_args!("{part}"));
            } else if self.cell.push_str(part).is_err() {
                let cell = core::mem::take(&mut self.cell);
                self.out.put(format_args!("{cell}{part}"));
            }
        }
        Ok(())
    }
}

/// Writes the next row of a table, from `place` on.
pub(super) fn row(
    out: &mut Output,
    layout: &Layout,
    place: &mut usize,
    write: &mut dyn FnMut(usize, &mut dyn fmt::Write) -> Written,
) -> Wait {
    let start = out.text.len();
    let last = layout.columns_in_all();
    loop {
        let mut cells = Cells { out, layout, at: 0, cell: Cell::new() };
        let written = write(*place, &mut cells);
        let Cells { at, cell, .. } = cells;
        out.put(format_args!("{cell}"));
        if written.is_none() {
            return Wait::End;
        }
        *place += 1;
        if out.text.len() > start {
            if !layout.columns.is_empty() {
                out.fold(if at > 0 { last } else { 0 });
            }
            out.end();
            return Wait::Sent;
        }
    }
}
