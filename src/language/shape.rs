//! The types of values in lines of settings, for interfaces that have them by name.

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

/// The name of a column, or a keyword, and the type of its value.
pub(crate) type Member = (&'static str, Shape);

/// The first columns of a port's line. Its kind has as many words as it needs.
pub(crate) const NAME: Member = ("name", Shape::Text);
/// See [`NAME`].
pub(crate) const KIND: Member = ("kind", Shape::Text);
