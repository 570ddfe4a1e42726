//! The types of values in lines of settings, for interfaces that have them by name.

use core::ops::RangeInclusive;

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    /// A keyword alone.
    Flag,
    /// A number within these limits.
    Number(u32, u32),
    /// Words.
    Text,
    /// Text in quotes.
    Quoted,
}

impl Shape {
    /// A number within `limits`.
    pub(crate) fn number<N: Copy + Into<u32>>(limits: RangeInclusive<N>) -> Self {
        Self::Number((*limits.start()).into(), (*limits.end()).into())
    }
}

/// The name of a column, or a keyword, and the type of its value.
pub(crate) type Member = (&'static str, Shape);

/// The first columns of a port's line. Its kind has as many words as it needs.
pub(crate) const NAME: Member = ("name", Shape::Text);
/// See [`NAME`].
pub(crate) const KIND: Member = ("kind", Shape::Text);
