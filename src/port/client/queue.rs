//! The request queue of a client-side port: selects the next request. Pure, with time as a value.
//!
//! A request is pushed with its [`Entry`]. [`PortQueue::next`] returns the one whose turn it is:
//!
//! 1. among the requests whose unit is ready, the highest priority present, except that a class passed over [`PASSED_OVER_MAX`]
//!    times in a row goes before the next higher one;
//! 2. in that class the address served longest ago, then its connection served longest ago, then first in, first out. So a client
//!    with nothing queued goes ahead of those that keep the line busy.
//!
//! Reads that share a transaction ([`PortQueue::companion`]) keep their own entries until then, so the group ranks like its most
//! urgent member, and each can expire on its own. The turn is charged to the requester that was selected, since identical reads
//! cost no line time; its companions keep their turns. Requesters whose reads made the combined read longer are charged too
//! ([`PortQueue::charge`]). No read overtakes a write.
//!
//! At most [`WAITING_MAX`] requests wait. When the queue is full, a new request evicts the newest one of the address with the
//! most requests, if that has more than the newcomer's address would have; otherwise it is refused.

use core::net::IpAddr;

use embassy_time::Instant;
use heapless::Vec;

use crate::gateway::unit_health::Ready;
use crate::settings::Priority;

mod fairness;
#[cfg(test)]
mod tests;

/// Requests that may wait at one port. With the feature `small`, no more than a small board has frames.
pub const WAITING_MAX: usize = if cfg!(feature = "small") { 24 } else { 64 };
/// Requesters whose last turn is remembered, which includes all that are waiting.
const REQUESTERS_MAX: usize = WAITING_MAX;
/// How often in a row a lower class with waiting requests is passed over.
pub const PASSED_OVER_MAX: u8 = 16;

/// A requester, for fairness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Requester {
    /// The port and its connection: distinguishes requesters behind one address, and serial ports. Compared first, as it usually
    /// decides.
    connection: (u8, u16),
    /// The client's address, hashed into as little memory as possible; 0 for serial clients.
    address: u32,
}

impl Requester {
    const NOBODY: Self = Self { connection: (u8::MAX, u16::MAX), address: 0 };

    /// The requester on `connection` (a port, and one of its connections) at `address`; serial clients have no address.
    pub fn new(connection: (u8, u16), address: Option<IpAddr>) -> Self {
        let address = match address {
            None => 0,
            Some(IpAddr::V4(address)) => address.to_bits(),
            // Two hosts with the same hash merely share their turns.
            Some(IpAddr::V6(address)) => {
                let bits = address.to_bits();
                let half = (bits >> 64) as u64 ^ bits as u64;
                (half >> 32) as u32 ^ half as u32
            }
        };
        Self { connection, address }
    }

    /// Whether both have the same address.
    pub fn shares_address(&self, other: &Self) -> bool {
        self.address == other.address
    }
}

/// The properties of a request that determine its turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Who sent it.
    pub requester: Requester,
    /// Its priority.
    pub priority: Priority,
    /// The unit id at this port.
    pub unit: u8,
    /// The request must not be sent after this.
    pub deadline: Instant,
    /// What it does to its unit.
    pub access: Access,
}

/// Access of a request to its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Writes, or may write: later reads must see the effect.
    Write,
    /// Reads, and needs a transaction of its own.
    Read,
    /// Reads, and may share a transaction with other reads.
    SharedRead,
}

/// The unit id of a broadcast.
pub(crate) const BROADCAST: u8 = 0;

/// The next step of the port.
#[derive(Debug, PartialEq, Eq)]
pub enum Next<T> {
    /// Send this request.
    Serve(T, Entry),
    /// Wait: nothing may be sent before this time.
    Wait(Instant),
    /// No requests.
    Empty,
}

/// A queued request with its entry.
struct Waiting<T> {
    request: T,
    /// Index in the table of requesters.
    requester: u8,
    unit: u8,
    priority: Priority,
    access: Access,
    deadline: Instant,
}

impl<T> Waiting<T> {
    fn writes_to(&self, unit: u8) -> bool {
        self.access == Access::Write && (self.unit == unit || self.unit == BROADCAST)
    }
}

/// A requester, with the last turn it had and the last turn its address had; 0 if none is remembered.
struct Known {
    requester: Requester,
    turn: u32,
    by_address: u32,
}

/// The request to serve.
struct Turn {
    class: usize,
    /// The classes that have a request ready.
    present: [bool; 3],
    /// Index of the request.
    index: usize,
}

/// Last turns of the address (upper half) and of the requester: the lowest goes first.
type Rank = u64;

/// The queue of one port.
pub struct PortQueue<T> {
    /// In order of arrival.
    waiting: Vec<Waiting<T>, WAITING_MAX>,
    requesters: Vec<Known, REQUESTERS_MAX>,
    turns: u32,
    /// How often in a row each class has been passed over.
    passed: [u8; 3],
}

impl<T> PortQueue<T> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self { waiting: Vec::new(), requesters: Vec::new(), turns: 0, passed: [0; 3] }
    }

    /// Number of waiting requests.
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Whether no request waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Queues `request`. Returns the request evicted for it, which may be `request` itself.
    pub fn push(&mut self, request: T, entry: Entry) -> Option<T> {
        let evicted = if self.waiting.is_full() {
            match self.eviction_candidate(entry.requester) {
                Some(index) => Some(self.waiting.remove(index).request),
                None => return Some(request),
            }
        } else {
            None
        };
        let waiting = self.waiting(request, entry);
        // Room was made above.
        let _ = self.waiting.push(waiting);
        evicted
    }

    fn waiting(&mut self, request: T, entry: Entry) -> Waiting<T> {
        let Entry { requester, priority, unit, deadline, access } = entry;
        Waiting { request, requester: self.slot_of(requester), unit, priority, access, deadline }
    }

    /// Removes and returns the request whose turn it is at `now`; `ready` returns when a unit may be asked.
    pub fn next(&mut self, now: Instant, ready: impl Fn(u8) -> Ready) -> Next<T> {
        let Turn { class, present, index } = match self.turn(now, ready) {
            Ok(turn) => turn,
            Err(earliest) => return earliest.map_or(Next::Empty, Next::Wait),
        };
        let waiting = self.waiting.remove(index);
        let entry = self.entry(&waiting);
        self.note_turn(waiting.requester);
        self.note_class(class, present);
        Next::Serve(waiting.request, entry)
    }

    /// The unit of the request whose turn it is at `now`, without removing it; otherwise the earliest time there may be one.
    pub fn first(&self, now: Instant, ready: impl Fn(u8) -> Ready) -> Result<u8, Instant> {
        let turn = self.turn(now, ready).map_err(|earliest| earliest.unwrap_or(Instant::MAX))?;
        self.waiting.get(turn.index).map(|waiting| waiting.unit).ok_or(Instant::MAX)
    }

    /// The request to serve; otherwise the earliest time there may be one, if any.
    fn turn(&self, now: Instant, ready: impl Fn(u8) -> Ready) -> Result<Turn, Option<Instant>> {
        // Per class.
        let mut first: [Option<(Rank, usize)>; 3] = [None; 3];
        let mut earliest: Option<Instant> = None;
        for (index, waiting) in self.waiting.iter().enumerate() {
            match ready(waiting.unit) {
                Ready::Elsewhere => {}
                Ready::At(at) if at > now => earliest = Some(earliest.map_or(at, |other| other.min(at))),
                Ready::At(_) | Ready::Now => {
                    let rank = self.rank(waiting);
                    // Among equals, the first to arrive.
                    if let Some(first) = first.get_mut(waiting.priority as usize)
                        && first.is_none_or(|(other, _)| rank < other)
                    {
                        *first = Some((rank, index));
                    }
                }
            }
        }
        let present = first.map(|first| first.is_some());
        let class = self.class(present).ok_or(earliest)?;
        let (_, index) = first.get(class).copied().flatten().ok_or(None)?;
        Ok(Turn { class, present, index })
    }

    /// The units of the waiting requests.
    pub fn units(&self) -> impl Iterator<Item = u8> {
        self.waiting.iter().map(|waiting| waiting.unit)
    }

    fn rank(&self, waiting: &Waiting<T>) -> Rank {
        let known = self.requester(waiting.requester);
        known.map_or(0, |known| Rank::from(known.by_address) << 32 | Rank::from(known.turn))
    }

    fn requester(&self, slot: u8) -> Option<&Known> {
        self.requesters.get(usize::from(slot))
    }

    /// The entry of a waiting request.
    fn entry(&self, waiting: &Waiting<T>) -> Entry {
        let Waiting { unit, priority, access, deadline, .. } = *waiting;
        let requester = self.requester(waiting.requester).map_or(Requester::NOBODY, |known| known.requester);
        Entry { requester, priority, unit, deadline, access }
    }

    /// The requests that may share the transaction of `leader`: reads of its unit with no write to that unit queued ahead of
    /// them.
    pub fn companions(&self, leader: &Entry) -> impl DoubleEndedIterator<Item = &T> {
        self.companion_slots(leader).map(|(_, waiting)| &waiting.request)
    }

    /// Removes and returns the last of the [companions](PortQueue::companions) for which `joins` holds.
    pub fn companion(&mut self, leader: &Entry, joins: impl Fn(&T) -> bool) -> Option<T> {
        let last = self.companion_slots(leader).rev().find(|(_, waiting)| joins(&waiting.request));
        let (index, _) = last?;
        Some(self.waiting.remove(index).request)
    }

    fn companion_slots(&self, leader: &Entry) -> impl DoubleEndedIterator<Item = (usize, &Waiting<T>)> {
        let Entry { unit, access, .. } = *leader;
        let before = match access {
            Access::SharedRead => self.waiting.iter().take_while(|waiting| !waiting.writes_to(unit)).count(),
            Access::Read | Access::Write => 0,
        };
        let may_share =
            move |waiting: &Waiting<T>| waiting.access == Access::SharedRead && waiting.unit == unit;
        let first = self.waiting.get(..before).unwrap_or(&[]);
        first.iter().enumerate().filter(move |(_, waiting)| may_share(waiting))
    }

    /// Charges a turn to `requester`, whose request was served along with another.
    pub fn charge(&mut self, requester: Requester) {
        let slot = self.slot_of(requester);
        self.note_turn(slot);
    }

    /// Puts an unsent request back at the front, so that nothing younger, such as a write, overtakes it. Returns it if there is no
    /// room.
    pub fn push_front(&mut self, request: T, entry: Entry) -> Option<T> {
        if self.waiting.is_full() {
            return Some(request);
        }
        let waiting = self.waiting(request, entry);
        // Checked above.
        let _ = self.waiting.insert(0, waiting);
        None
    }

    /// Whether a write to `unit` is waiting.
    pub fn writes_to(&self, unit: u8) -> bool {
        self.waiting.iter().any(|waiting| waiting.writes_to(unit))
    }

    /// Removes one request for which `unwanted` returns a reason, and returns both.
    pub fn take_if<R>(&mut self, unwanted: impl Fn(&T, &Entry) -> Option<R>) -> Option<(T, R)> {
        let found = self.waiting.iter().enumerate();
        let (index, reason) = found
            .filter_map(|(index, waiting)| Some((index, unwanted(&waiting.request, &self.entry(waiting))?)))
            .next()?;
        Some((self.waiting.remove(index).request, reason))
    }

    /// The earliest deadline of the waiting requests.
    pub fn first_deadline(&self) -> Option<Instant> {
        self.waiting.iter().map(|waiting| waiting.deadline).min()
    }

    /// The class to serve among those `present`: the highest, unless a lower one has been passed over too often.
    fn class(&self, present: [bool; 3]) -> Option<usize> {
        const NORMAL: usize = Priority::Normal as usize;
        const LOW: usize = Priority::Low as usize;
        let highest = present.iter().position(|present| *present)?;
        let [_, normal, low] = present;
        let [_, normal_passed, low_passed] = self.passed;
        // An overdue low class may delay normal requests, or a flood of high ones, but not a sparse high class.
        let low_bound = if highest == NORMAL { PASSED_OVER_MAX } else { 2 * PASSED_OVER_MAX };
        if low && low_passed >= low_bound {
            Some(LOW)
        } else if normal && normal_passed >= PASSED_OVER_MAX {
            Some(NORMAL)
        } else {
            Some(highest)
        }
    }

    fn note_class(&mut self, served: usize, present: [bool; 3]) {
        for (class, (passed, present)) in self.passed.iter_mut().zip(present).enumerate() {
            *passed = if class > served && present { passed.saturating_add(1) } else { 0 };
        }
    }
}

/// Adds to a count in a table, and returns it.
fn add(counts: &mut [u8; REQUESTERS_MAX], slot: usize, more: u8) -> u8 {
    counts.get_mut(slot).map_or(0, |count| {
        *count += more;
        *count
    })
}
