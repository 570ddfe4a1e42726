//! The turns of connections whose requests are refused: one after the other, for all of the gateway together.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::{Duration, Instant};

/// From one turn to the next.
const TURN: Duration = Duration::from_millis(2);

/// When those may go on who have brought nothing but refusals.
pub(crate) struct Turns(Mutex<CriticalSectionRawMutex, Cell<Instant>>);

impl Turns {
    /// Nobody waits.
    pub(crate) const fn new() -> Self {
        Self(Mutex::new(Cell::new(Instant::MIN)))
    }

    /// The next turn: at `now` if nobody waits.
    pub(crate) fn take(&self, now: Instant) -> Instant {
        self.0.lock(|next| {
            let turn = next.get().max(now);
            next.set(turn + TURN);
            turn
        })
    }
}
