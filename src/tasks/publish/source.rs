//! What the parts of a publisher share.

use core::fmt;

use embassy_time::Instant;

use crate::gateway::Gateway;
use crate::gateway::publishers::state::PublisherState;
use crate::settings::Publisher;

/// Writes a date, as [`System::write_date`](crate::hal::System::write_date) does, with milliseconds.
pub(super) type WriteDate = fn(Instant, &mut dyn fmt::Write) -> Option<fmt::Result>;

/// What a publisher's parts share.
pub(super) struct Source<'s, 'g> {
    pub(super) gateway: &'s Gateway<'g>,
    pub(super) publisher: &'s Publisher,
    /// Its number in the settings, by which a board finds its certificates.
    #[cfg_attr(not(feature = "tls"), allow(dead_code))]
    pub(super) nth: usize,
    pub(super) state: &'s PublisherState,
    pub(super) write_date: WriteDate,
}
