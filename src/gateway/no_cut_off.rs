//! Stub for sessions that are cut off, without the feature `candidate`: nothing is refused, for there is no way to take it back.

use core::convert::Infallible;

use super::audit::Actor;
use crate::settings::{PortId, Settings};

/// There is no reason.
pub(crate) type CutOff = Infallible;

pub(crate) fn cut_off(_: &Settings, _: &Settings, _: Actor<'_>, _: Option<PortId>) -> Option<CutOff> {
    None
}
