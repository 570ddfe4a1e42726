//! Texts of JSON.

use core::fmt::{self, Write};

use crate::language::json::Escaped;
pub(super) use crate::language::json::Quoted;

/// Columns whose cells are numbers.
const NUMBERS: &[&str] =
    &["NO", "UNIT", "REQUESTS", "RESPONSES", "EXCEPTIONS", "FAILURES", "TIMEOUTS", "OPEN"];

/// A row of a table, cells separated by tabs, as an object with the columns' names of the `heading`.
pub(super) struct Row<'w> {
    out: &'w mut dyn Write,
    heading: core::str::Split<'w, char>,
    /// What ends the current cell; empty before the first one.
    end: Option<&'static str>,
    /// The cell has begun with something else than blanks.
    begun: bool,
}

impl<'w> Row<'w> {
    pub(super) fn new(out: &'w mut dyn Write, heading: &'w str) -> Self {
        Self { out, heading: heading.split('\t'), end: None, begun: false }
    }

    /// Ends the object; returns whether there is one.
    pub(super) fn finish(self) -> Result<bool, fmt::Error> {
        match self.end {
            Some(end) => write!(self.out, "{end}}}").map(|()| true),
            None => Ok(false),
        }
    }

    /// Begins the next cell.
    fn next(&mut self) -> fmt::Result {
        let key = self.heading.next().unwrap_or_default();
        let before = self.end.map_or("{", |_| ",");
        write!(self.out, "{}{before}\"", self.end.unwrap_or_default())?;
        let letter = |char: char| if char == '-' { '_' } else { char.to_ascii_lowercase() };
        key.chars().try_for_each(|char| self.out.write_char(letter(char)))?;
        let quote = if NUMBERS.contains(&key) { "" } else { "\"" };
        (self.end, self.begun) = (Some(quote), false);
        write!(self.out, "\":{quote}")
    }
}

impl Write for Row<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        if self.end.is_none() && !text.is_empty() {
            self.next()?;
        }
        for (nth, part) in text.split('\t').enumerate() {
            if nth > 0 {
                self.next()?;
            }
            let part = if self.begun { part } else { part.trim_start() };
            self.begun |= !part.is_empty();
            Escaped(self.out).write_str(part)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::String;

    use super::*;

    #[test]
    fn a_row_is_an_object_with_the_names_of_the_columns() {
        let mut out = String::new();
        let mut row = Row::new(&mut out, "PORT\tUNIT\tPER-MINUTE\tLAST");
        write!(row, "P\"1\t{}", 7).unwrap();
        write!(row, "\t\t  12ms, a b").unwrap();
        assert!(row.finish().unwrap());
        assert_eq!(out, r#"{"port":"P\"1","unit":7,"per_minute":"","last":"12ms, a b"}"#);
        let mut out = String::new();
        assert!(!Row::new(&mut out, "PORT").finish().unwrap());
        assert_eq!(out, "");
    }
}
