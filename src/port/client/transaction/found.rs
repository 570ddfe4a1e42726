//! What a look at a line finds.

use crate::stats::Event;

/// What a look at the line found.
pub(super) enum Found {
    /// Nothing yet, or noise between frames.
    Nothing,
    /// The response.
    Response,
    /// The response, but damaged, and what is wrong with it.
    Corrupt(Event),
    /// Something else, which has been counted.
    Other,
}
