//! Who is served next at a client-side port: a pure queue, with time as a value.
//!
//! A request is pushed with its [`Entry`] and waits. [`PortQueue::next`] gives the request whose turn it is:
//!
//! 1. among the requests whose unit is ready, the highest priority present, except that a class that was passed over
//!    [`PASSED_OVER_MAX`] times in a row goes before the next higher one;
//! 2. in that class the address that was served longest ago, then the connection of it served longest ago, then
//!    first in, first out. So a client with nothing queued goes ahead of those that keep the line busy.
//!
//! The read that is served takes others along ([`PortQueue::companion`]), each of which keeps its own entry till then: so
//! its rank is that of the most urgent of them, and each can expire by itself. The turn is charged to the requester whose turn it
//! was, since identical reads cost the line nothing; next time it is another's turn. Those that made the read longer are
//! charged, too ([`PortQueue::charge`]). None overtakes a write.
//!
//! At most [`WAITING_MAX`] requests wait. When the queue is full, a newcomer takes the place of the newest order of the
//! address that has most of them, if that is more than the newcomer's address would have; else it is refused.

use core::net::IpAddr;

use embassy_time::Instant;
use heapless::Vec;

use crate::gateway::unit_health::Ready;
use crate::settings::Priority;

mod fairness;
#[cfg(test)]
mod tests;

/// Requests that may wait at one port. With the feature `small` a port does not hold more than a small board has frames.
pub const WAITING_MAX: usize = if cfg!(feature = "small") { 24 } else { 64 };
/// Requesters whose last turn is remembered; those of all that wait are among them.
const REQUESTERS_MAX: usize = WAITING_MAX;
/// How often in a row a lower class is passed over while it has requests waiting.
pub const PASSED_OVER_MAX: u8 = 16;

/// Who asked, as far as fairness goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Requester {
    /// The port and its connection: tells those of an address, and the serial ports, apart. The first to be compared: mostly it tells.
    connection: (u8, u16),
    /// The client's address, in as little memory as tells it from others; all serial requesters have 0.
    address: u32,
}

impl Requester {
    const NOBODY: Self = Self { connection: (u8::MAX, u16::MAX), address: 0 };

    /// Who asks by `connection` (a port, and which of its connections) from `address`; from a serial line there is none.
    pub fn new(connection: (u8, u16), address: Option<IpAddr>) -> Self {
        let address = match address {
            None => 0,
            Some(IpAddr::V4(address)) => address.to_bits(),
            // Two hosts for which this is the same share their turns, that is all.
            Some(IpAddr::V6(address)) => {
                let bits = address.to_bits();
                let half = (bits >> 64) as u64 ^ bits as u64;
                (half >> 32) as u32 ^ half as u32
            }
        };
        Self { connection, address }
    }

    /// Whether both ask from one address.
    pub fn is_beside(&self, other: &Self) -> bool {
        self.address == other.address
    }
}

/// What the queue must know of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Who asked.
    pub requester: Requester,
    /// Its rank.
    pub priority: Priority,
    /// The unit asked, on this port's side.
    pub unit: u8,
    /// From here on the request must not be sent.
    pub deadline: Instant,
    /// What it does to the unit.
    pub access: Access,
}

/// What a request does to its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// It changes something, or may: what comes after it must see that.
    Write,
    /// It reads, and wants a response of its own.
    Read,
    /// It reads, and may share a transaction with others that do.
    SharedRead,
}

/// The unit id of a request to all units of a line.
pub(crate) const BROADCAST: u8 = 0;

/// What the port shall do next.
#[derive(Debug, PartialEq, Eq)]
pub enum Next<T> {
    /// Send this request.
    Serve(T, Entry),
    /// Nothing can be sent before this time.
    Wait(Instant),
    /// No requests.
    Empty,
}

/// A request, and what its entry says.
struct Waiting<T> {
    request: T,
    /// Its requester's place in the table.
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

/// A requester who waits or was served, and when he and his address had their last turns; 0: none is remembered.
struct Known {
    requester: Requester,
    turn: u32,
    by_address: u32,
}

/// Whose turn it is.
struct Turn {
    class: usize,
    /// Of which classes requests could be served.
    present: [bool; 3],
    /// The request's place.
    index: usize,
}

/// The last turns of the requester's address and of the requester: the lowest is first.
type Rank = (u32, u32);

/// The requests that wait at one port.
pub struct PortQueue<T> {
    /// In the order of arrival.
    waiting: Vec<Waiting<T>, WAITING_MAX>,
    requesters: Vec<Known, REQUESTERS_MAX>,
    turns: u32,
    /// Times that normal and low requests were passed over in a row.
    passed: [u8; 3],
}

impl<T> PortQueue<T> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self { waiting: Vec::new(), requesters: Vec::new(), turns: 0, passed: [0; 3] }
    }

    /// Requests that wait.
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Whether none waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Adds `request`. Gives back the request that had to go for it, which may be `request` itself.
    pub fn push(&mut self, request: T, entry: Entry) -> Option<T> {
        let evicted = if self.waiting.is_full() {
            match self.crowder(entry.requester) {
                Some(index) => Some(self.waiting.remove(index).request),
                None => return Some(request),
            }
        } else {
            None
        };
        let waiting = self.waiting(request, entry);
        // There is room now.
        let _ = self.waiting.push(waiting);
        evicted
    }

    fn waiting(&mut self, request: T, entry: Entry) -> Waiting<T> {
        let Entry { requester, priority, unit, deadline, access } = entry;
        Waiting { request, requester: self.slot_of(requester), unit, priority, access, deadline }
    }

    /// The request whose turn it is at `now`; `ready` says when a unit may be asked.
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

    /// The unit of the request whose turn it is at `now`, which goes on waiting; else the time before which there is none.
    pub fn first(&self, now: Instant, ready: impl Fn(u8) -> Ready) -> Result<u8, Instant> {
        let turn = self.turn(now, ready).map_err(|earliest| earliest.unwrap_or(Instant::MAX))?;
        self.waiting.get(turn.index).map(|waiting| waiting.unit).ok_or(Instant::MAX)
    }

    /// Whose turn it is; else when it is somebody's, if anybody's at all.
    fn turn(&self, now: Instant, ready: impl Fn(u8) -> Ready) -> Result<Turn, Option<Instant>> {
        // Of each class.
        let mut first: [Option<(Option<Rank>, usize)>; 3] = [None; 3];
        let mut earliest: Option<Instant> = None;
        for (index, waiting) in self.waiting.iter().enumerate() {
            match ready(waiting.unit) {
                Ready::Elsewhere => {}
                Ready::At(at) if at > now => earliest = Some(earliest.map_or(at, |other| other.min(at))),
                Ready::At(_) | Ready::Now => {
                    let rank = self.rank(waiting);
                    // Of equals the one that came first.
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

    /// The units of those that wait.
    pub fn units(&self) -> impl Iterator<Item = u8> {
        self.waiting.iter().map(|waiting| waiting.unit)
    }

    fn rank(&self, waiting: &Waiting<T>) -> Option<Rank> {
        self.requester(waiting.requester).map(|known| (known.by_address, known.turn))
    }

    fn requester(&self, slot: u8) -> Option<&Known> {
        self.requesters.get(usize::from(slot))
    }

    /// What is known of a request that waits.
    fn entry(&self, waiting: &Waiting<T>) -> Entry {
        let Waiting { unit, priority, access, deadline, .. } = *waiting;
        let requester = self.requester(waiting.requester).map_or(Requester::NOBODY, |known| known.requester);
        Entry { requester, priority, unit, deadline, access }
    }

    /// The requests that may share a transaction with the one served with `leader`: reads of its unit before which no write to
    /// that unit waits.
    pub fn companions(&self, leader: &Entry) -> impl DoubleEndedIterator<Item = &T> {
        self.companion_slots(leader).map(|(_, waiting)| &waiting.request)
    }

    /// Takes out the last one of the [companions](PortQueue::companions) that `joins`.
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

    /// Counts a turn of `requester`, who was served along with another one.
    pub fn charge(&mut self, requester: Requester) {
        let slot = self.slot_of(requester);
        self.note_turn(slot);
    }

    /// Puts a request back that has not been carried out after all, in front of all that wait: nothing that came after it may
    /// go before it, such as a write. Gives it back when there is no room any more.
    pub fn put_back(&mut self, request: T, entry: Entry) -> Option<T> {
        if self.waiting.is_full() {
            return Some(request);
        }
        let waiting = self.waiting(request, entry);
        // There is room.
        let _ = self.waiting.insert(0, waiting);
        None
    }

    /// Whether a write to `unit` waits.
    pub fn writes_to(&self, unit: u8) -> bool {
        self.waiting.iter().any(|waiting| waiting.writes_to(unit))
    }

    /// Takes out one request for which `unwanted` gives a reason, with the reason.
    pub fn take_if<R>(&mut self, unwanted: impl Fn(&T, &Entry) -> Option<R>) -> Option<(T, R)> {
        let found = self.waiting.iter().enumerate();
        let (index, reason) = found
            .filter_map(|(index, waiting)| Some((index, unwanted(&waiting.request, &self.entry(waiting))?)))
            .next()?;
        Some((self.waiting.remove(index).request, reason))
    }

    /// The earliest deadline of all that wait.
    pub fn first_deadline(&self) -> Option<Instant> {
        self.waiting.iter().map(|waiting| waiting.deadline).min()
    }

    /// The class to serve of those `present`: the highest, unless a lower one was passed over too often.
    fn class(&self, present: [bool; 3]) -> Option<usize> {
        const NORMAL: usize = Priority::Normal as usize;
        const LOW: usize = Priority::Low as usize;
        let highest = present.iter().position(|present| *present)?;
        let [_, normal, low] = present;
        let [_, normal_passed, low_passed] = self.passed;
        // A sparse high class is not held up by an overdue low one: only normal requests are, or a high flood.
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

/// Adds to a count in a table, and gives it.
fn add(counts: &mut [u8; REQUESTERS_MAX], slot: usize, more: u8) -> u8 {
    counts.get_mut(slot).map_or(0, |count| {
        *count += more;
        *count
    })
}

impl<T> Default for PortQueue<T> {
    fn default() -> Self {
        Self::new()
    }
}
