//! Keeping the configuration over power-off (1010h, 1011h): what the MainDevice asks for, whoever has the store does.
//!
//! A store is slow: the SDO is answered when it is done, and process data go on meanwhile.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant};

/// How long a store may take.
const PATIENCE: Duration = Duration::from_secs(30);

/// What is to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Keep {
    /// The settings are to be saved, with the configuration.
    Save = 0,
    /// The settings are to be saved, without any slaves.
    Restore = 1,
}

impl Keep {
    /// What a MainDevice writes for it, as letters and as a number (CiA 301, 7.5.2.13 and 14).
    pub(super) const fn signature(self) -> u32 {
        u32::from_le_bytes(*match self {
            Self::Save => b"save",
            Self::Restore => b"load",
        })
    }
}

/// Where the wish and the outcome change hands.
pub(super) struct Keeping {
    state: Mutex<CriticalSectionRawMutex, Cell<State>>,
    wanted: Signal<CriticalSectionRawMutex, ()>,
}

#[derive(Clone, Copy)]
struct State {
    /// Whether anybody has a store.
    has_store: bool,
    keep: Keep,
    kept: Kept,
    since: Instant,
}

/// How a wish is doing.
// `Nothing` is the 0: a place is all zeros at start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kept {
    /// There is none, or nobody waits for it any more.
    Nothing,
    /// Whoever has the store has not seen it.
    Wanted,
    /// It is being done.
    Going,
    /// It was done.
    Done,
    /// It could not be done.
    Failed,
}

impl Keeping {
    pub(super) const fn new() -> Self {
        let state = State { has_store: false, keep: Keep::Save, kept: Kept::Nothing, since: Instant::MIN };
        Self { state: Mutex::new(Cell::new(state)), wanted: Signal::new() }
    }

    /// Whether anybody has a store.
    pub(super) fn has_store(&self) -> bool {
        self.state.lock(Cell::get).has_store
    }

    /// Begins with `keep`.
    pub(super) fn begin(&self, keep: Keep) {
        let State { has_store, .. } = self.state.lock(Cell::get);
        let state = State { has_store, keep, kept: Kept::Wanted, since: Instant::now() };
        self.state.lock(|cell| cell.set(state));
        self.wanted.signal(());
    }

    /// Nobody waits for an outcome any more: the MainDevice has started anew, or it was told.
    pub(super) fn forget(&self) {
        let state = self.state.lock(Cell::get);
        self.state.lock(|cell| cell.set(State { kept: Kept::Nothing, ..state }));
    }

    /// How it is doing; an outcome is told once.
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

    /// Waits for a wish, as somebody who has a store.
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

    /// What came of it.
    pub(super) fn done(&self, well: bool) {
        let state = self.state.lock(Cell::get);
        // Nobody may wait any more, or for another one, which has not begun.
        if state.kept == Kept::Going {
            let kept = if well { Kept::Done } else { Kept::Failed };
            self.state.lock(|cell| cell.set(State { kept, ..state }));
        }
    }
}
