//! Stub for the candidate, without the feature `candidate`.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::MutexGuard;

use crate::settings::Settings;

/// There is none.
pub struct Candidate(());

impl Default for Candidate {
    fn default() -> Self {
        Self::new()
    }
}

impl Candidate {
    /// No candidate.
    pub const fn new() -> Self {
        Self(())
    }

    pub(crate) fn is_open(&self) -> bool {
        false
    }

    pub(crate) fn is_waiting(&self) -> bool {
        false
    }

    pub(crate) fn settle(&self) {}

    pub(crate) fn lock(&self) -> Option<MutexGuard<'_, CriticalSectionRawMutex, Settings>> {
        None
    }
}
