//! Turns for connections whose requests are refused: one at a time, for the whole gateway.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::{Duration, Instant};

/// Time between turns.
const TURN: Duration = Duration::from_millis(2);

/// The time of the next free turn.
pub(crate) struct Turns(Mutex<CriticalSectionRawMutex, Cell<Instant>>);

impl Turns {
    /// Without waiting connections.
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Cell::new(Instant::MIN)))
    }

    /// The next turn: `now` if no connection is waiting.
    pub(crate) fn take(&self, now: Instant) -> Instant {
        self.0.lock(|next| {
            let turn = next.get().max(now);
            next.set(turn + TURN);
            turn
        })
    }
}
