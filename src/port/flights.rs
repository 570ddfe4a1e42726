//! Requests that are open on one connection: pure, with time as a value.
//!
//! Each has a transaction id of the connection's own. The id of a request that timed out is *lost*: it is not given again
//! before its late answer can no longer come, so that such an answer is never taken for another request's.

use embassy_time::{Duration, Instant};
use heapless::Vec;

/// Requests that may be open at a time (Messaging on TCP/IP 4.4.1.1: NumberMaxOfServerTransaction, 1 to 16).
pub const FLIGHTS_MAX: usize = 16;
/// Ids that can be lost at a time: with the default window there are no more than requests. When all are, no request is sent
/// until the first one's window is over.
const LOST_MAX: usize = if cfg!(feature = "small") { FLIGHTS_MAX } else { 2 * FLIGHTS_MAX };

/// A request that waits for its answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flight<T> {
    /// Its transaction id.
    pub id: u16,
    /// The request itself.
    pub order: T,
    /// The unit id as it was sent.
    pub unit: u8,
    /// When it was sent.
    pub sent: Instant,
}

/// The open requests of a connection.
pub struct Flights<T> {
    open: Vec<Flight<T>, FLIGHTS_MAX>,
    /// Each with the end of its window.
    lost: Vec<(u16, Instant), LOST_MAX>,
    next: u16,
    /// So long after a request there is no answer to it.
    timeout: Duration,
}

impl<T> Flights<T> {
    /// None. Ids begin with `first`, and requests have their answers within `timeout`.
    pub const fn new(first: u16, timeout: Duration) -> Self {
        Self { open: Vec::new(), lost: Vec::new(), next: first, timeout }
    }

    /// Requests that are open.
    pub fn len(&self) -> usize {
        self.open.len()
    }

    /// Whether none is.
    pub fn is_empty(&self) -> bool {
        self.open.is_empty()
    }

    /// When one more can be opened: at `now`, or when a lost id's window is over. `None`: when one has ended.
    pub fn room(&self, now: Instant) -> Option<Instant> {
        if self.open.is_full() {
            return None;
        }
        let (mut lost, mut first) = (0, Instant::MAX);
        for (_, until) in self.lost.iter().filter(|(_, until)| *until > now) {
            lost += 1;
            first = first.min(*until);
        }
        // Each open request may come to be lost, too.
        Some(if lost + self.open.len() < LOST_MAX { now } else { first })
    }

    /// Opens a request and gives its id; gives the request back when there is no [`Flights::room`].
    pub fn start(&mut self, order: T, unit: u8, now: Instant) -> Result<u16, T> {
        self.forget_lost(now);
        if self.room(now) != Some(now) {
            return Err(order);
        }
        while self.find(self.next).is_some() || self.is_lost(self.next) {
            self.next = self.next.wrapping_add(1);
        }
        let id = self.next;
        self.next = id.wrapping_add(1);
        let flight = Flight { id, order, unit, sent: now };
        self.open.push(flight).map(|()| id).map_err(|flight| flight.order)
    }

    /// The open request with this id.
    pub fn find(&self, id: u16) -> Option<&Flight<T>> {
        self.open.iter().find(|flight| flight.id == id)
    }

    /// Whether an open request's order `is` the one looked for.
    pub fn holds(&self, is: impl Fn(&T) -> bool) -> bool {
        self.open.iter().any(|flight| is(&flight.order))
    }

    /// The request that was opened first.
    pub fn first(&self) -> Option<&Flight<T>> {
        self.open.first()
    }

    /// Closes the request with this id: it has its answer.
    pub fn finish(&mut self, id: u16) -> Option<Flight<T>> {
        let at = self.open.iter().position(|flight| flight.id == id)?;
        Some(self.open.remove(at))
    }

    /// Closes one request whose time is over; its answer may come for `window` more.
    pub fn expire(&mut self, now: Instant, window: Duration) -> Option<Flight<T>> {
        let at = self.open.iter().position(|flight| flight.sent + self.timeout <= now)?;
        let flight = self.open.remove(at);
        self.forget_lost(now);
        // `room` has kept a place for it.
        let _ = self.lost.push((flight.id, now + window));
        Some(flight)
    }

    /// Closes one request, whichever: the connection has ended.
    pub fn pop(&mut self) -> Option<Flight<T>> {
        self.open.pop()
    }

    /// When the first request's time is over.
    pub fn first_deadline(&self) -> Option<Instant> {
        self.open.iter().map(|flight| flight.sent + self.timeout).min()
    }

    /// Forgets the ids whose windows are over.
    fn forget_lost(&mut self, now: Instant) {
        while let Some(over) = self.lost.iter().position(|(_, until)| *until <= now) {
            self.lost.swap_remove(over);
        }
    }

    fn is_lost(&self, id: u16) -> bool {
        self.lost.iter().any(|(lost, _)| *lost == id)
    }
}
