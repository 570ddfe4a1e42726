//! Stub without the feature `candidate`: nothing is refused, because no change can be confirmed later.

use core::convert::Infallible;

use super::audit::Actor;
use crate::settings::{PortId, Settings};

/// There is no reason.
pub(crate) type CutOff = Infallible;

/// How a session has come in.
#[allow(dead_code)] // Nobody asks here.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way {
    pub(crate) port: Option<PortId>,
    pub(crate) by_name: bool,
}

pub(crate) fn cut_off(_: &Settings, _: &Settings, _: Actor<'_>, _: Way) -> Option<CutOff> {
    None
}
