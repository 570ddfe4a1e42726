//! Why a body was not taken.

use heapless::String;

use crate::language::LineError;
use crate::settings::LINE_BYTES_MAX;

/// A line of settings.
pub(super) type Line = String<LINE_BYTES_MAX>;
/// The name of a member, which is cut if it is longer than each that is known.
type Name = String<24>;

/// Why a body was not taken.
// Passed on once, and there is no heap for the larger one.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Untaken {
    /// This line, by its number from 1, has an error.
    #[error("{2}")]
    Line(usize, Line, LineError),
    /// What was expected, and where: bytes from 1.
    #[error("the body is not as described: expected {0} at byte {1}")]
    Expected(&'static str, usize),
    #[error("the body is not as described: there is no \"{0}\"")]
    Unknown(Name),
    #[error("the body is not as described: \"{0}\" is missing")]
    Missing(&'static str),
    #[error("the body is not as described: \"{0}\" has no words of a line")]
    NoWords(Name),
    #[error("\"{0}\" is not one word of its kind")]
    NotAWord(&'static str),
    #[error("expected values, or one as text")]
    #[cfg(feature = "long-values")] // As text.
    NoValue,
    #[error("the request is too long")]
    TooLong,
}

impl Untaken {
    pub(super) fn too_long() -> Self {
        Self::Line(0, Line::new(), LineError::too_long())
    }

    pub(super) fn unknown(name: &str) -> Self {
        Self::Unknown(cut(name))
    }
}

/// The beginning of a text, as much as fits.
pub(super) fn cut<const BYTES: usize>(whole: &str) -> String<BYTES> {
    let mut text = String::new();
    whole.chars().take_while(|char| text.push(*char).is_ok()).for_each(drop);
    text
}
