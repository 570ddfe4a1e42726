//! Lines of settings from a body: as they are, or made of an object of JSON.

use core::fmt::Write;

use heapless::Vec;

use super::reader::Reader;
use super::untaken::{Line, Untaken, cut};
use crate::language::LineError;
use crate::language::forms::{Shape, forms};

/// Columns of all forms of a verb.
const COLUMNS_MAX: usize = 12;

/// The lines of a body.
#[derive(Clone, Copy)]
pub(super) enum Lines<'b> {
    Text(&'b str),
    Json(&'b str),
}

/// Takes a line.
type Take<'t> = &'t mut dyn FnMut(usize, &str) -> Result<(), LineError>;

impl Lines<'_> {
    /// Has each line taken, with its number. Those of an object come in the order in which settings are printed.
    pub(super) fn each(self, take: Take<'_>) -> Result<(), Untaken> {
        match self {
            Self::Text(text) => text.lines().enumerate().try_for_each(|(nth, line)| {
                take(nth + 1, line).map_err(|error| Untaken::Line(nth + 1, cut(line), error))
            }),
            Self::Json(text) => {
                let mut number = 0;
                let mut before = "";
                forms().map(|form| form.verb).try_for_each(|verb| {
                    // Kinds of ports are forms of one verb.
                    if core::mem::replace(&mut before, verb) == verb {
                        return Ok(());
                    }
                    lines_of(verb, text, &mut number, take)
                })?;
                // An object without any is checked, too.
                Ok(())
            }
        }
    }
}

/// The lines that begin with `verb`.
fn lines_of(verb: &'static str, text: &str, number: &mut usize, take: Take<'_>) -> Result<(), Untaken> {
    let mut reader = Reader::new(text);
    reader.object(&mut |reader, name| {
        if name == verb {
            return reader.list(&mut |reader| {
                let line = line(verb, reader)?;
                *number += 1;
                take(*number, &line).map_err(|error| Untaken::Line(*number, line, error))
            });
        }
        match forms().any(|form| form.verb == name) {
            true => reader.skip_list(),
            false => Err(Untaken::unknown(name)),
        }
    })?;
    reader.end()
}

/// The line of an object.
fn line(verb: &'static str, reader: &mut Reader<'_>) -> Result<Line, Untaken> {
    let columns = columns(verb);
    // Values of columns, in any order, with their places; and the options.
    let (mut values, mut places) = (Line::new(), [(0, 0); COLUMNS_MAX]);
    let mut options = Line::new();
    reader.object(&mut |reader, name| {
        let shape = forms().filter(|form| form.verb == verb).find_map(|form| form.member(name));
        let shape = shape.ok_or_else(|| Untaken::unknown(name))?;
        let column = columns.iter().position(|column| *column == name);
        let out = if column.is_some() { &mut values } else { &mut options };
        let begin = out.len();
        if column.is_none() {
            write!(out, " {name} ").map_err(|_| Untaken::too_long())?;
        }
        if !value(shape, reader, out, name)? {
            out.truncate(begin);
        } else if let Some(place) = column.and_then(|column| places.get_mut(column)) {
            *place = (begin, out.len());
        }
        Ok(())
    })?;
    let mut line = Line::new();
    let mut written = line.write_str(verb);
    for (begin, end) in places {
        let value = values.get(begin..end).unwrap_or_default();
        let separator = if value.is_empty() { "" } else { " " };
        written = written.and_then(|()| write!(line, "{separator}{value}"));
    }
    let written = written.and_then(|()| line.write_str(options.trim_end()));
    written.map(|()| line).map_err(|_| Untaken::too_long())
}

/// The columns of all forms of a verb, in an order that fits each.
fn columns(verb: &str) -> Vec<&'static str, COLUMNS_MAX> {
    let mut all = Vec::new();
    for (name, _) in forms().filter(|form| form.verb == verb).flat_map(|form| form.columns) {
        if !all.contains(name) {
            // As many as there are.
            let _ = all.push(*name);
        }
    }
    all
}

/// Appends the value of member `name`; whether it is there.
fn value(shape: Shape, reader: &mut Reader<'_>, out: &mut Line, name: &str) -> Result<bool, Untaken> {
    let written = match shape {
        Shape::Flag => return reader.flag(),
        Shape::Number(..) => write!(out, "{}", reader.whole(u32::MAX)?),
        Shape::Text | Shape::Quoted => {
            let mut text = Line::new();
            reader.text(&mut text)?;
            let quoted = matches!(shape, Shape::Quoted);
            let is_bare = || text.split(' ').all(|word| !word.is_empty() && !word.starts_with('#'));
            if text.contains(|char: char| char == '"' || char.is_control()) || !(quoted || is_bare()) {
                return Err(Untaken::NoWords(cut(name)));
            }
            let quote = if quoted { "\"" } else { "" };
            write!(out, "{quote}{text}{quote}")
        }
    };
    written.map(|()| true).map_err(|_| Untaken::too_long())
}
