//! Stands in for periodic writes in images without `long-values`: there are none.

use embassy_time::{Duration, Instant};

use super::status::Status;

/// There is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Period {}

#[allow(missing_docs)] // Never called.
impl Period {
    pub const fn duration(self) -> Duration {
        match self {}
    }
}

#[derive(Clone, Copy)]
pub(super) struct Again;

impl Again {
    pub(super) const NEVER: Self = Self;

    pub(super) fn sent(&mut self, _: Option<Period>, _: Instant) {}

    pub(super) fn due(self, _: Status) -> Instant {
        Instant::MAX
    }

    pub(super) fn is_armed(self) -> bool {
        false
    }
}
