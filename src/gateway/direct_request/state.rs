//! The shared state of a console's direct request: its outcome, and the settings on trial.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::Duration;
use portable_atomic::{AtomicBool, AtomicU16, Ordering};

use crate::frame::Channel;
use crate::settings::{LineSettings, PortId, PortKind, SerialClientSettings};
use crate::stats::Event;

/// Why there is no response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Failure {
    /// No response in time; it may still arrive.
    Timeout,
    /// The response was corrupt, in this way.
    Corrupt(Event),
    /// Another device was sending at the same time.
    Collision,
}

/// The outcome on a serial line: the time from the end of the request to the response, or the failure.
pub(crate) type Outcome = Result<Duration, Failure>;

/// Shared state of direct requests.
pub(crate) struct DirectRequestState {
    pub(crate) responses: Channel,
    pub(super) generation: AtomicU16,
    pub(super) taken: AtomicBool,
    pub(super) trial: Mutex<CriticalSectionRawMutex, Cell<Option<Trial>>>,
    /// Outcome of the last request, if it was sent on a serial line.
    pub(super) outcome: Mutex<CriticalSectionRawMutex, Cell<Option<Outcome>>>,
}

/// Trial settings for a serial client's line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trial {
    pub(crate) port: PortId,
    /// The line settings on trial.
    pub(crate) line: LineSettings,
    /// The response time-out on trial.
    pub(crate) timeout: Duration,
    /// Whether other requests are refused meanwhile, and the port learns nothing about its units.
    pub(crate) alone: bool,
}

impl DirectRequestState {
    pub(crate) const fn new() -> Self {
        Self {
            responses: Channel::new(),
            generation: AtomicU16::new(0),
            taken: AtomicBool::new(false),
            trial: Mutex::new(Cell::new(None)),
            outcome: Mutex::new(Cell::new(None)),
        }
    }

    /// Whether the response to request number `generation` is still wanted.
    pub(crate) fn waits_for(&self, generation: u16) -> bool {
        self.taken.load(Ordering::Relaxed) && self.generation.load(Ordering::Relaxed) == generation
    }

    /// Stores the outcome on a serial line.
    pub(crate) fn note(&self, outcome: Outcome) {
        self.outcome.lock(|last| last.set(Some(outcome)));
    }

    /// Puts the trial settings for port `id` into `kind`; returns whether other requests are refused meanwhile.
    pub(crate) fn try_on(&self, id: PortId, kind: Option<&mut PortKind>) -> bool {
        let trial = self.trial.lock(Cell::get).filter(|trial| trial.port == id);
        let (Some(trial), Some(PortKind::Serial(serial))) = (trial, kind) else { return false };
        serial.line = trial.line;
        let start_delay = Duration::from_ticks(0);
        let (timeout, late_window) = (trial.timeout, None);
        serial.client = SerialClientSettings { timeout, late_window, start_delay, ..serial.client };
        trial.alone
    }
}
