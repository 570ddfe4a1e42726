//! What the parts of a publisher share.

use core::cell::Cell;

use embassy_time::Instant;

use crate::gateway::Gateway;
use crate::gateway::date::Date;
use crate::gateway::publishers::state::PublisherState;
use crate::settings::{Format, Publisher};

/// Tells the date of a time, on boards with a calendar.
pub(super) type Calendar = fn(Instant) -> Option<Date>;

/// What a publisher's parts share.
pub(super) struct Source<'s, 'g> {
    pub(super) gateway: &'s Gateway<'g>,
    pub(super) publisher: &'s Publisher,
    /// Its number in the settings, by which a board finds its certificates.
    #[cfg_attr(not(feature = "tls"), allow(dead_code))]
    pub(super) nth: usize,
    pub(super) state: &'s PublisherState,
    pub(super) calendar: Calendar,
    /// The number of the connection, for Sparkplug (bdSeq).
    pub(super) bd_seq: &'s Cell<u8>,
}

impl Source<'_, '_> {
    pub(super) fn is_sparkplug(&self) -> bool {
        self.publisher.format == Format::Sparkplug
    }

    /// The date of `at`, if it is known.
    pub(super) fn date(&self, at: Instant) -> Option<Date> {
        self.gateway.date(at).or_else(|| (self.calendar)(at))
    }
}
