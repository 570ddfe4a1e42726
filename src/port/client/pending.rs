//! Requests in flight on one connection. Pure, with time as a value.
//!
//! Each has a transaction id of the connection's own. The id of a request that timed out is *lost*: it is not reused until its
//! late response can no longer arrive, so that such a response is never matched to another request.

use embassy_time::{Duration, Instant};
use heapless::Vec;

/// Requests in flight at a time (Messaging on TCP/IP 4.4.1.1: NumberMaxOfServerTransaction, 1 to 16).
pub const PENDING_MAX: usize = 16;
/// Requests in flight plus lost ids. With the default window there are no more lost ids than requests; without room, sending
/// pauses until the oldest window is over.
const ALL_MAX: usize = if cfg!(feature = "small") { PENDING_MAX } else { 2 * PENDING_MAX };

/// A request waiting for its response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PendingRequest<T> {
    /// Its transaction id.
    pub id: u16,
    /// The request itself.
    pub request: T,
    /// The unit id as sent.
    pub unit: u8,
    /// When it was sent.
    pub sent: Instant,
}

/// A pending request, or the id of one that timed out.
enum Entry<T> {
    Open(PendingRequest<T>),
    /// The id, and the end of its window.
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

    /// Whether this is a lost id whose window is over.
    fn is_over(&self, now: Instant) -> bool {
        matches!(self, Self::Lost(_, until) if *until <= now)
    }
}

/// The pending requests of a connection.
pub struct PendingRequests<T> {
    /// In order of sending.
    all: Vec<Entry<T>, ALL_MAX>,
    next: u16,
    /// Response time-out.
    timeout: Duration,
}

impl<T> PendingRequests<T> {
    /// An empty list. Ids start at `first`; `timeout` is the response time-out.
    pub const fn new(first: u16, timeout: Duration) -> Self {
        Self { all: Vec::new(), next: first, timeout }
    }

    fn open(&self) -> impl DoubleEndedIterator<Item = &PendingRequest<T>> {
        self.all.iter().filter_map(Entry::open)
    }

    /// Number of pending requests.
    pub fn len(&self) -> usize {
        self.open().count()
    }

    /// Whether no request is pending.
    pub fn is_empty(&self) -> bool {
        self.first().is_none()
    }

    /// When another request can be sent: `now`, or when a lost id's window ends. `None` means: once a pending request has ended.
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

    /// Adds a request and returns its id, or returns the request if there is no [`PendingRequests::room`].
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
        // `room` was checked above.
        match self.all.push(Entry::Open(PendingRequest { id, request, unit, sent: now })) {
            Err(Entry::Open(pending)) => Err(pending.request),
            _ => Ok(id),
        }
    }

    /// The pending request with this id.
    pub fn find(&self, id: u16) -> Option<&PendingRequest<T>> {
        self.open().find(|pending| pending.id == id)
    }

    /// The ids of these requests, and those whose responses may still arrive.
    pub(crate) fn ids(&self) -> impl Iterator<Item = u16> {
        self.all.iter().map(Entry::id)
    }

    /// Whether `is` holds for a pending request.
    pub fn holds(&self, is: impl Fn(&T) -> bool) -> bool {
        self.open().any(|pending| is(&pending.request))
    }

    /// The oldest pending request.
    pub fn first(&self) -> Option<&PendingRequest<T>> {
        self.open().next()
    }

    /// Removes the request with this id, which has its response.
    pub fn finish(&mut self, id: u16) -> Option<PendingRequest<T>> {
        self.close(|pending| pending.id == id, |_| None)
    }

    /// Removes one request past its time-out; its response may still arrive during `window`.
    pub fn expire(&mut self, now: Instant, window: Duration) -> Option<PendingRequest<T>> {
        let timeout = self.timeout;
        self.close(|pending| pending.sent + timeout <= now, |id| Some(Entry::Lost(id, now + window)))
    }

    /// Removes any one request: the connection has ended.
    pub fn pop(&mut self) -> Option<PendingRequest<T>> {
        self.close(|_| true, |_| None)
    }

    /// Removes the first request for which `is` holds; its slot goes to what `lost` makes of its id.
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

    /// When the oldest request times out.
    pub fn first_deadline(&self) -> Option<Instant> {
        self.open().map(|pending| pending.sent + self.timeout).min()
    }
}
