//! A minimal XML writer: nested, indented elements with escaped text.

use std::fmt::{Arguments, Display, Error, Formatter, Write};

/// Writes elements.
pub(super) struct Xml<'w, W> {
    into: &'w mut W,
    depth: usize,
}

impl<'w, W: Write> Xml<'w, W> {
    pub(super) fn new(into: &'w mut W) -> Self {
        Self { into, depth: 0 }
    }

    /// An element with child elements.
    pub(super) fn within(
        &mut self,
        name: &str,
        attributes: Arguments<'_>,
        content: impl FnOnce(&mut Self) -> Result<(), Error>,
    ) -> Result<(), Error> {
        self.indent()?;
        writeln!(self.into, "<{name}{attributes}>")?;
        self.depth += 1;
        content(self)?;
        self.depth -= 1;
        self.indent()?;
        writeln!(self.into, "</{name}>")
    }

    /// An element with text and attributes.
    pub(super) fn element(
        &mut self,
        name: &str,
        attributes: Arguments<'_>,
        text: Arguments<'_>,
    ) -> Result<(), Error> {
        self.indent()?;
        write!(self.into, "<{name}{attributes}>")?;
        write!(Escaped(&mut *self.into), "{text}")?;
        writeln!(self.into, "</{name}>")
    }

    /// An element with text.
    pub(super) fn text(&mut self, name: &str, text: Arguments<'_>) -> Result<(), Error> {
        self.element(name, format_args!(""), text)
    }

    /// An empty element.
    pub(super) fn empty(&mut self, name: &str, attributes: Arguments<'_>) -> Result<(), Error> {
        self.indent()?;
        writeln!(self.into, "<{name}{attributes}/>")
    }

    fn indent(&mut self) -> Result<(), Error> {
        (0..self.depth).try_for_each(|_| self.into.write_str("  "))
    }
}

struct Escaped<'w, W>(&'w mut W);

impl<W: Write> Write for Escaped<'_, W> {
    fn write_str(&mut self, text: &str) -> Result<(), Error> {
        text.chars().try_for_each(|letter| match letter {
            '&' => self.0.write_str("&amp;"),
            '<' => self.0.write_str("&lt;"),
            '>' => self.0.write_str("&gt;"),
            _ => self.0.write_char(letter),
        })
    }
}

/// Bytes in hexadecimal digits.
pub(super) struct Hex<'a>(pub(super) &'a [u8]);

impl Display for Hex<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result<(), Error> {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02X}"))
    }
}
