//! The state of a publisher, which its task shares with consoles.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

use crate::gateway::port_state::Status;
use crate::gateway::shared::Shared;
use crate::settings::PUBLISHERS_MAX;

/// How a publisher does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Report {
    pub(crate) status: Status,
    /// When it was connected, or when the connection ended.
    pub(crate) since: Instant,
    /// Messages that the broker has acknowledged.
    pub(crate) sent: u32,
    /// Messages to send, and those not acknowledged yet.
    pub(crate) queued: u16,
    /// Values that a newer one has replaced before they were sent, and messages that the broker refused or that were too long.
    pub(crate) lost: u32,
}

impl Report {
    pub(crate) const NONE: Self =
        Self { status: Status::Off, since: Instant::MIN, sent: 0, queued: 0, lost: 0 };
}

/// The state of a publisher.
// Images without publishers have none.
#[cfg_attr(not(feature = "mqtt"), allow(dead_code))]
pub(crate) struct PublisherState {
    /// Its line is another, or the points are.
    pub(crate) changed: Signal<CriticalSectionRawMutex, ()>,
    /// A value may be another.
    pub(crate) values: Signal<CriticalSectionRawMutex, ()>,
    report: Shared<Report>,
}

/// The state of all.
pub(in crate::gateway) type PublisherStates = [PublisherState; PUBLISHERS_MAX];

#[cfg_attr(not(feature = "mqtt"), allow(dead_code))]
impl PublisherState {
    pub(in crate::gateway) const fn new() -> Self {
        Self { changed: Signal::new(), values: Signal::new(), report: Mutex::new(RefCell::new(Report::NONE)) }
    }

    /// How it does, after `change`.
    pub(crate) fn report(&self, change: impl FnOnce(&mut Report)) -> Report {
        self.report.lock(|report| {
            let mut report = report.borrow_mut();
            change(&mut report);
            *report
        })
    }
}
