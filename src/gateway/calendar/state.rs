//! The state of the calendar.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

use crate::gateway::date::Date;
use crate::gateway::shared::Shared;
use crate::hal::OpenError;
use crate::settings::ServerAddress;

/// What is known of the time.
pub(in crate::gateway) struct Calendar {
    pub(super) state: Shared<TimeState>,
    pub(in crate::gateway) server_changed: Signal<CriticalSectionRawMutex, ()>,
}

impl Calendar {
    pub(in crate::gateway) const fn new() -> Self {
        Self { state: Mutex::new(RefCell::new(TimeState::UNKNOWN)), server_changed: Signal::new() }
    }
}

/// The known time, and its source.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct TimeState {
    /// When this run began.
    pub(super) start: Option<Date>,
    /// The server that supplied it.
    pub(super) source: Option<ServerAddress>,
    /// Why the last request failed.
    pub(super) fault: Option<OpenError>,
}

impl TimeState {
    const UNKNOWN: Self = Self { start: None, source: None, fault: None };

    /// The date of `at`, if it is known.
    pub(super) fn date(&self, at: Instant) -> Option<Date> {
        Some(Date(self.start?.0.saturating_add(at.as_micros())))
    }
}
