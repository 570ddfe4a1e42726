//! What a line changed.

use crate::settings::PortId;

/// What a line changed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Changed {
    Nothing,
    Port(PortId),
    /// The rule at this index is new.
    Rule(usize),
    Other,
}
