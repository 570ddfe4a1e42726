//! The data behind tables, and their headings.

use core::fmt;

use embassy_time::Instant;

use super::output::Written;
use crate::gateway::{Gateway, PortAt};
use crate::settings::{Port, PortId, Settings};

/// The data behind tables.
#[derive(Clone, Copy)]
pub(super) struct Source<'t, 'g> {
    pub(super) gateway: &'t Gateway<'g>,
    pub(super) settings: &'t Settings,
    pub(super) now: Instant,
}

impl<'t> Source<'t, '_> {
    /// Port `at` and its state: `None` after the last one, `Some(None)` for an unused one.
    pub(super) fn port(&self, at: usize) -> Option<Option<(&'t Port, PortAt<'t>)>> {
        let state = self.gateway.port_state(PortId(u8::try_from(at).ok()?))?;
        Some(self.settings.ports.get(at)?.as_ref().map(|port| (port, state)))
    }
}

/// Writes `heading` at place 0, and the rows from place 1 on.
pub(super) fn titled(
    heading: &str,
    place: usize,
    out: &mut dyn fmt::Write,
    row: impl FnOnce(usize, &mut dyn fmt::Write) -> Written,
) -> Written {
    match place.checked_sub(1) {
        None => Some(out.write_str(heading)),
        Some(nth) => row(nth, out),
    }
}
