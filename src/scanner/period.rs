//! Periodic writes, for devices with a watchdog: the value written last is written again.

use embassy_time::{Duration, Instant};

use super::status::Status;

/// How often a value is written again, in milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Period(pub u32);

impl Period {
    /// The time between two writes.
    pub const fn duration(self) -> Duration {
        Duration::from_millis(self.0 as u64)
    }
}

/// When a row's value is written again by itself; never before a first write.
#[derive(Clone, Copy)]
pub(super) struct Again(Instant);

impl Again {
    pub(super) const NEVER: Self = Self(Instant::MAX);

    /// Records that a write is sent at `now`.
    pub(super) fn sent(&mut self, period: Option<Period>, now: Instant) {
        self.0 = period.map_or(Instant::MAX, |period| now + period.duration());
    }

    /// When to mark the row; not while it is marked, written or in a safe write.
    pub(super) fn due(self, status: Status) -> Instant {
        let is_written = Status::WRITE_MARKED.with(Status::CURRENT_IS_WRITE).with(Status::WRITE_BLOCKED);
        if status.any(is_written) { Instant::MAX } else { self.0 }
    }

    /// Whether there was a first write.
    pub(super) fn is_armed(self) -> bool {
        self.0 != Instant::MAX
    }
}
