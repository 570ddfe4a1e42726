//! The result of matching bytes received from a line.

use crate::stats::Event;

/// The result of matching the bytes received so far.
pub(super) enum Found {
    /// Nothing yet, or noise between frames.
    Nothing,
    /// The response.
    Response,
    /// The response, but corrupt, with the reason.
    Corrupt(Event),
    /// Something else, which has been counted.
    Other,
}
