//! Saves the configuration on a MainDevice's request (1010h, 1011h); the owner of the store does the work.
//!
//! A store is slow: the SDO is answered on completion, and process data continue meanwhile.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant};

/// Timeout of a store.
const PATIENCE: Duration = Duration::from_secs(30);

/// The request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Keep {
    /// Save the settings with the configuration.
    Save = 0,
    /// Save the settings without slaves.
    Restore = 1,
}

impl Keep {
    /// The signature that a MainDevice writes: letters, as a number (CiA 301, 7.5.2.13 and 14).
    pub(super) const fn signature(self) -> u32 {
        u32::from_le_bytes(*match self {
            Self::Save => b"save",
            Self::Restore => b"load",
        })
    }
}

/// Passes the request to the owner of the store, and the outcome back.
pub(super) struct Keeping {
    state: Mutex<CriticalSectionRawMutex, Cell<State>>,
    wanted: Signal<CriticalSectionRawMutex, ()>,
}

#[derive(Clone, Copy)]
struct State {
    /// Whether there is a store.
    has_store: bool,
    keep: Keep,
    kept: Kept,
    since: Instant,
}

/// Progress of a request.
// `Nothing` is 0, so that a static is all zeros at start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kept {
    /// No request, or its outcome is no longer needed.
    Nothing,
    /// Not taken up by the owner of the store yet.
    Wanted,
    /// In progress.
    Going,
    /// Succeeded.
    Done,
    /// Failed.
    Failed,
}

impl Keeping {
    pub(super) const fn new() -> Self {
        let state = State { has_store: false, keep: Keep::Save, kept: Kept::Nothing, since: Instant::MIN };
        Self { state: Mutex::new(Cell::new(state)), wanted: Signal::new() }
    }

    /// Whether there is a store.
    pub(super) fn has_store(&self) -> bool {
        self.state.lock(Cell::get).has_store
    }

    /// Requests `keep`.
    pub(super) fn begin(&self, keep: Keep) {
        let State { has_store, .. } = self.state.lock(Cell::get);
        let state = State { has_store, keep, kept: Kept::Wanted, since: Instant::now() };
        self.state.lock(|cell| cell.set(state));
        self.wanted.signal(());
    }

    /// Drops the outcome: the MainDevice has restarted, or has received it.
    pub(super) fn forget(&self) {
        let state = self.state.lock(Cell::get);
        self.state.lock(|cell| cell.set(State { kept: Kept::Nothing, ..state }));
    }

    /// The progress; an outcome is returned once.
    pub(super) fn outcome(&self) -> Kept {
        let state = self.state.lock(Cell::get);
        let kept = match state.kept {
            Kept::Wanted | Kept::Going if state.since.elapsed() >= PATIENCE => Kept::Failed,
            kept => kept,
        };
        if matches!(kept, Kept::Done | Kept::Failed) {
            self.forget();
        }
        kept
    }

    /// Waits for a request. To be called by the owner of a store.
    pub(super) async fn wanted(&self) -> Keep {
        let state = self.state.lock(Cell::get);
        self.state.lock(|cell| cell.set(State { has_store: true, ..state }));
        self.wanted.wait().await;
        let state = self.state.lock(Cell::get);
        if state.kept == Kept::Wanted {
            self.state.lock(|cell| cell.set(State { kept: Kept::Going, ..state }));
        }
        state.keep
    }

    /// Reports the outcome.
    pub(super) fn done(&self, well: bool) {
        let state = self.state.lock(Cell::get);
        // The request may have been dropped, or replaced by one that has not started.
        if state.kept == Kept::Going {
            let kept = if well { Kept::Done } else { Kept::Failed };
            self.state.lock(|cell| cell.set(State { kept, ..state }));
        }
    }
}
