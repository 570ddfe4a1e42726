//! The effect of a line on the settings.

use crate::settings::PortId;

/// The effect of a line on the settings.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Changed {
    Nothing,
    Port(PortId),
    /// The rule at this index is new.
    Rule(usize),
    Other,
}
