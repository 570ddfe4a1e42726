//! What tasks share of a console's direct request: the way back to it, and what it tries at a line.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU16, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::Duration;

use crate::frame::Channel;
use crate::settings::{LineSettings, PortId, PortKind, SerialClientSettings};
use crate::stats::Event;

/// Why there is no response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Failure {
    /// None came in time; it may still come.
    Timeout,
    /// It came corrupted, and this is what was wrong with it.
    Corrupt(Event),
    /// The request was corrupted by somebody who sent at the same time.
    Collision,
}

/// What a serial line brought for a request: the time from the request's end to the response's, or what came instead.
pub(crate) type Outcome = Result<Duration, Failure>;

/// The way back to the console that asks, and what it tries.
pub(crate) struct DirectRequestState {
    pub(crate) responses: Channel,
    pub(super) generation: AtomicU16,
    pub(super) taken: AtomicBool,
    pub(super) trial: Mutex<CriticalSectionRawMutex, Cell<Option<Trial>>>,
    /// What came of the last request, if it went on a serial line.
    pub(super) outcome: Mutex<CriticalSectionRawMutex, Cell<Option<Outcome>>>,
}

/// Other settings of a serial client's line for a while.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trial {
    /// The port.
    pub(crate) port: PortId,
    /// Instead of the port's own.
    pub(crate) line: LineSettings,
    /// Instead of the port's own.
    pub(crate) timeout: Duration,
    /// Whether all others are refused at once, and the port forgets what it learns of its units.
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

    /// Whether somebody waits for the response to request number `generation`.
    pub(crate) fn waits_for(&self, generation: u16) -> bool {
        self.taken.load(Ordering::Relaxed) && self.generation.load(Ordering::Relaxed) == generation
    }

    /// Notes what came of a request on a serial line.
    pub(crate) fn note(&self, outcome: Outcome) {
        self.outcome.lock(|last| last.set(Some(outcome)));
    }

    /// Puts what is tried at the port `id` into its settings; says whether all others are refused meanwhile.
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
