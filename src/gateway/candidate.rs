//! A candidate: settings that lines change one by one, and that a commit applies all at once, permanently or until a deadline by
//! which the commit must be confirmed.
//!
//! While there is a candidate, lines at all consoles change it, and not the settings in force. A commit that waits for its
//! confirmation is not saved, so that a reset takes it back, too. The memory of the candidate has meanwhile the settings to go
//! back to.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::MutexGuard;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant};

use super::shared::{Draft, Shared};
use crate::settings::Settings;

/// The candidate of a gateway, which needs its own memory.
pub struct Candidate {
    /// Those of the candidate, or those to go back to.
    pub(super) settings: Draft,
    stage: Shared<Stage>,
    pub(super) changed: Signal<CriticalSectionRawMutex, ()>,
}

/// What there is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    Nothing,
    /// A candidate, and the number of changes to the settings in force when it was begun.
    Open {
        changes: u32,
    },
    /// A commit that ends at this time unless it is confirmed, and whether settings were not saved before it.
    Waiting {
        until: Instant,
        unsaved: bool,
    },
}

impl Default for Candidate {
    fn default() -> Self {
        Self::new()
    }
}

impl Candidate {
    /// No candidate.
    pub const fn new() -> Self {
        Self {
            settings: Draft::new(Settings::new()),
            stage: Shared::new(RefCell::new(Stage::Nothing)),
            changed: Signal::new(),
        }
    }

    pub(super) fn stage(&self) -> Stage {
        self.stage.lock(|stage| *stage.borrow())
    }

    pub(super) fn set(&self, stage: Stage) {
        self.stage.lock(|place| *place.borrow_mut() = stage);
        self.changed.signal(());
    }

    /// Whether lines change the candidate.
    pub(crate) fn is_open(&self) -> bool {
        matches!(self.stage(), Stage::Open { .. })
    }

    /// Whether a commit waits for its confirmation.
    pub(crate) fn is_waiting(&self) -> bool {
        matches!(self.stage(), Stage::Waiting { .. })
    }

    /// How long a commit still waits for its confirmation.
    pub(crate) fn remaining(&self, now: Instant) -> Option<Duration> {
        match self.stage() {
            Stage::Waiting { until, .. } => Some(until.saturating_duration_since(now)),
            _ => None,
        }
    }

    /// Settings from the store are in force: no commit is pending any more.
    pub(crate) fn settle(&self) {
        if self.is_waiting() {
            self.set(Stage::Nothing);
        }
    }

    /// The candidate's settings, unless somebody is committing them.
    pub(crate) fn lock(&self) -> Option<MutexGuard<'_, CriticalSectionRawMutex, Settings>> {
        self.settings.try_lock().ok()
    }
}
