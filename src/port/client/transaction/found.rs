//! What matching finds in the bytes received from a line.

use crate::stats::Event;

/// What was found in the bytes received so far.
pub(super) enum Found {
    /// Nothing yet, or noise between frames.
    Nothing,
    /// The response.
    Response,
    /// The response, but corrupt, and how.
    Corrupt(Event),
    /// Something else, which has been counted.
    Other,
}
