//! Requests that are open on one connection: pure, with time as a value.
//!
//! Each has a transaction id of the connection's own. The id of a request that timed out is *lost*: it is not given again
//! before its late response can no longer come, so that such a response is never taken for another request's.

use embassy_time::{Duration, Instant};
use heapless::Vec;

/// Requests that may be open at a time (Messaging on TCP/IP 4.4.1.1: NumberMaxOfServerTransaction, 1 to 16).
pub const PENDING_MAX: usize = 16;
/// Requests that are open and ids that are lost, together: with the default window there are no more lost ids than requests. When
/// there is no room, no request is sent until the first one's window is over.
const ALL_MAX: usize = if cfg!(feature = "small") { PENDING_MAX } else { 2 * PENDING_MAX };

/// A request that waits for its response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PendingRequest<T> {
    /// Its transaction id.
    pub id: u16,
    /// The request itself.
    pub request: T,
    /// The unit id as it was sent.
    pub unit: u8,
    /// When it was sent.
    pub sent: Instant,
}

/// A request, or the id of one that timed out.
enum Entry<T> {
    Open(PendingRequest<T>),
    /// With the end of its window.
    Lost(u16, Instant),
}

impl<T> Entry<T> {
    fn open(&self) -> Option<&PendingRequest<T>> {
        match self {
            Self::Open(pending) => Some(pending),
            Self::Lost(..) => None,
        }
    }

    fn id(&self) -> u16 {
        match self {
            Self::Open(pending) => pending.id,
            Self::Lost(id, _) => *id,
        }
    }

    /// Whether it is a lost id whose window is over.
    fn is_over(&self, now: Instant) -> bool {
        matches!(self, Self::Lost(_, until) if *until <= now)
    }
}

/// The open requests of a connection.
pub struct PendingRequests<T> {
    /// In the order in which they were opened.
    all: Vec<Entry<T>, ALL_MAX>,
    next: u16,
    /// So long after a request there is no response to it.
    timeout: Duration,
}

impl<T> PendingRequests<T> {
    /// None. Ids begin with `first`, and requests have their responses within `timeout`.
    pub const fn new(first: u16, timeout: Duration) -> Self {
        Self { all: Vec::new(), next: first, timeout }
    }

    fn open(&self) -> impl DoubleEndedIterator<Item = &PendingRequest<T>> {
        self.all.iter().filter_map(Entry::open)
    }

    /// Requests that are open.
    pub fn len(&self) -> usize {
        self.open().count()
    }

    /// Whether none is.
    pub fn is_empty(&self) -> bool {
        self.first().is_none()
    }

    /// When one more can be opened: at `now`, or when a lost id's window is over. `None`: when one has ended.
    pub fn room(&self, now: Instant) -> Option<Instant> {
        if self.len() >= PENDING_MAX {
            return None;
        }
        let (mut taken, mut first) = (0, Instant::MAX);
        for entry in self.all.iter().filter(|entry| !entry.is_over(now)) {
            taken += 1;
            if let Entry::Lost(_, until) = entry {
                first = first.min(*until);
            }
        }
        Some(if taken < ALL_MAX { now } else { first })
    }

    /// Opens a request and gives its id; gives the request back when there is no [`PendingRequests::room`].
    pub fn start(&mut self, request: T, unit: u8, now: Instant) -> Result<u16, T> {
        while let Some(over) = self.all.iter().position(|entry| entry.is_over(now)) {
            self.all.remove(over);
        }
        if self.room(now) != Some(now) {
            return Err(request);
        }
        while self.all.iter().any(|entry| entry.id() == self.next) {
            self.next = self.next.wrapping_add(1);
        }
        let id = self.next;
        self.next = id.wrapping_add(1);
        // There is room.
        match self.all.push(Entry::Open(PendingRequest { id, request, unit, sent: now })) {
            Err(Entry::Open(pending)) => Err(pending.request),
            _ => Ok(id),
        }
    }

    /// The open request with this id.
    pub fn find(&self, id: u16) -> Option<&PendingRequest<T>> {
        self.open().find(|pending| pending.id == id)
    }

    /// Whether an open request's order `is` the one looked for.
    pub fn holds(&self, is: impl Fn(&T) -> bool) -> bool {
        self.open().any(|pending| is(&pending.request))
    }

    /// The request that was opened first.
    pub fn first(&self) -> Option<&PendingRequest<T>> {
        self.open().next()
    }

    /// Closes the request with this id: it has its response.
    pub fn finish(&mut self, id: u16) -> Option<PendingRequest<T>> {
        self.close(|pending| pending.id == id, |_| None)
    }

    /// Closes one request whose time is over; its response may come for `window` more.
    pub fn expire(&mut self, now: Instant, window: Duration) -> Option<PendingRequest<T>> {
        let timeout = self.timeout;
        self.close(|pending| pending.sent + timeout <= now, |id| Some(Entry::Lost(id, now + window)))
    }

    /// Closes one request, whichever: the connection has ended.
    pub fn pop(&mut self) -> Option<PendingRequest<T>> {
        self.close(|_| true, |_| None)
    }

    /// Closes the first request that `is` the one wanted; what `lost` makes of its id takes its place.
    fn close(
        &mut self,
        is: impl Fn(&PendingRequest<T>) -> bool,
        lost: impl FnOnce(u16) -> Option<Entry<T>>,
    ) -> Option<PendingRequest<T>> {
        let at = self.all.iter().position(|entry| entry.open().is_some_and(&is))?;
        let entry = match lost(self.all.get(at)?.id()) {
            Some(lost) => core::mem::replace(self.all.get_mut(at)?, lost),
            None => self.all.remove(at),
        };
        match entry {
            Entry::Open(pending) => Some(pending),
            Entry::Lost(..) => None,
        }
    }

    /// When the first request's time is over.
    pub fn first_deadline(&self) -> Option<Instant> {
        self.open().map(|pending| pending.sent + self.timeout).min()
    }
}
