//! How the rows of a table are laid out: in columns as wide as they have to be.
//!
//! A row is written as cells with a tab behind each but the last one, which is a text of any length. A program gets columns of
//! fixed widths at least. At a terminal that is too narrow for these they are as wide as what stands in them; what has no room even
//! then goes on in the next line, in the same place of each row.

use core::fmt;

use super::output::{Output, Written};
use super::rows::Cell;
use super::wait::Wait;

/// Columns of a table, besides the last one.
const COLUMNS_MAX: usize = 10;
/// Least room for the last cell in its line.
const LAST_MIN: usize = 12;

/// The columns of a table besides the last one: their least widths, negative where cells are flush right.
pub(super) type Columns = &'static [i8];

/// Columns with the widths that they have got.
#[derive(Clone, Copy)]
pub(super) struct Layout {
    columns: Columns,
    widths: [u8; COLUMNS_MAX],
}

impl Layout {
    /// Of a table whose cells are not known, or of lines that are no rows.
    pub(super) fn fixed(columns: Columns) -> Self {
        let mut layout = Self { columns, widths: [0; COLUMNS_MAX] };
        layout.widen();
        layout
    }

    /// Of a table whose rows `write` gives, as far as `room` goes.
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

/// Finds out how wide cells are.
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

/// Puts cells into their columns.
struct Cells<'o> {
    out: &'o mut Output,
    layout: &'o Layout,
    at: usize,
    /// The cell so far. A text without a tab is none, however long it is.
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
        // The last one is not gathered: it may be long.
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
                // A list of options begins with a blank.
                let part = if self.at > 0 && self.out.text.ends_with(' ') { part.trim_start() } else { part };
                self.out.put(format_args!("{part}"));
            } else if self.cell.push_str(part).is_err() {
                let cell = core::mem::take(&mut self.cell);
                self.out.put(format_args!("{cell}{part}"));
            }
        }
        Ok(())
    }
}

/// Writes the next row that there is of a table, from `place` on.
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
        // It was no row.
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
