//! Stub without the feature `candidate`: nothing is refused, because no change can be confirmed later.

use core::convert::Infallible;

use super::audit::{Actor, Way};
use crate::settings::Settings;

/// There is no reason.
pub(crate) type CutOff = Infallible;

pub(crate) fn cut_off(_: &Settings, _: &Settings, _: Actor<'_>, _: Way) -> Option<CutOff> {
    None
}
