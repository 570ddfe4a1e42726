//! Who is served next at a client-side port: a pure queue, with time as a value.
//!
//! An order is pushed with its [`Ticket`] and waits. [`PortQueue::next`] gives the order whose turn it is:
//!
//! 1. among the orders whose unit is ready, the highest priority present, except that a class that was passed over
//!    [`PASSED_OVER_MAX`] times in a row goes before the next higher one;
//! 2. in that class the address that was served longest ago, then the connection of it served longest ago, then
//!    first in, first out. So a client with nothing queued goes ahead of those that keep the line busy.
//!
//! The read that is served takes others along ([`PortQueue::companion`]), each of which keeps its own ticket till then: so
//! its rank is that of the most urgent of them, and each can expire by itself. The turn is charged to the asker whose turn it
//! was, since identical reads cost the line nothing; next time it is another's turn. Those that made the read longer are
//! charged, too ([`PortQueue::charge`]). None overtakes a write.
//!
//! At most [`WAITING_MAX`] orders wait. When the queue is full, a newcomer takes the place of the newest order of the
//! address that has most of them, if that is more than the newcomer's address would have; else it is refused.

use core::net::IpAddr;

use embassy_time::Instant;
use heapless::Vec;

use crate::route::Priority;

/// Orders that may wait at one port. With the feature `small` a port does not hold more than a small board has frames.
pub const WAITING_MAX: usize = if cfg!(feature = "small") { 24 } else { 64 };
/// Askers whose last turn is remembered.
const ASKERS_MAX: usize = WAITING_MAX;
/// How often in a row a lower class is passed over while it has orders waiting.
pub const PASSED_OVER_MAX: u8 = 16;

/// Who asked, as far as fairness goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Asker {
    /// The client's address; all serial askers have none.
    pub address: Option<IpAddr>,
    /// Tells the connections of an address, and the serial ports, apart.
    pub connection: u32,
}

/// What the queue must know of an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ticket {
    /// Who asked.
    pub asker: Asker,
    /// Its rank.
    pub priority: Priority,
    /// The unit asked, on this port's side.
    pub unit: u8,
    /// From here on the order must not be sent.
    pub deadline: Instant,
    /// What it does to the unit.
    pub access: Access,
}

/// What an order does to its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// It changes something, or may: what comes after it must see that.
    Write,
    /// It reads, and wants an answer of its own.
    Read,
    /// It reads, and may share a transaction with others that do.
    SharedRead,
}

/// The unit id of an order to all units of a line.
pub(crate) const BROADCAST: u8 = 0;

impl Ticket {
    fn writes_to(&self, unit: u8) -> bool {
        self.access == Access::Write && (self.unit == unit || self.unit == BROADCAST)
    }
}

/// When a unit may be asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ready {
    /// At once.
    Now,
    /// Not before this time.
    At(Instant),
}

/// What the port shall do next.
#[derive(Debug, PartialEq, Eq)]
pub enum Next<T> {
    /// Send this order.
    Serve(T, Ticket),
    /// Nothing can be sent before this time.
    Wait(Instant),
    /// No orders.
    Empty,
}

struct Waiting<T> {
    order: T,
    ticket: Ticket,
    /// Position in the order of arrival.
    arrival: u32,
}

/// When an asker was served last, in turns of this queue.
struct Served {
    asker: Asker,
    turn: u32,
}

/// The orders that wait at one port.
pub struct PortQueue<T> {
    /// In the order of arrival.
    waiting: Vec<Waiting<T>, WAITING_MAX>,
    served: Vec<Served, ASKERS_MAX>,
    arrivals: u32,
    turns: u32,
    /// Times that normal and low orders were passed over in a row.
    passed: [u8; 3],
}

impl<T> PortQueue<T> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self { waiting: Vec::new(), served: Vec::new(), arrivals: 0, turns: 0, passed: [0; 3] }
    }

    /// Orders that wait.
    pub fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Whether none waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Adds `order`. Gives back the order that had to go for it, which may be `order` itself.
    pub fn push(&mut self, order: T, ticket: Ticket) -> Option<T> {
        let evicted = if self.waiting.is_full() {
            match self.crowder(ticket.asker) {
                Some(index) => Some(self.waiting.remove(index).order),
                None => return Some(order),
            }
        } else {
            None
        };
        self.arrivals = self.arrivals.wrapping_add(1);
        let refused = self.waiting.push(Waiting { order, ticket, arrival: self.arrivals });
        refused.err().map(|refused| refused.order).or(evicted)
    }

    /// The order whose turn it is at `now`; `ready` says when a unit may be asked.
    pub fn next(&mut self, now: Instant, ready: impl Fn(u8) -> Ready) -> Next<T> {
        let mut best = None;
        let mut earliest: Option<Instant> = None;
        let mut present = [false; 3];
        for waiting in &self.waiting {
            match ready(waiting.ticket.unit) {
                Ready::At(at) if at > now => earliest = Some(earliest.map_or(at, |other| other.min(at))),
                _ => present[waiting.ticket.priority as usize] = true,
            }
        }
        let Some(class) = self.class(present) else {
            return earliest.map_or(Next::Empty, Next::Wait);
        };
        for (index, waiting) in self.waiting.iter().enumerate() {
            let is_ready = !matches!(ready(waiting.ticket.unit), Ready::At(at) if at > now);
            if !is_ready || waiting.ticket.priority as usize != class {
                continue;
            }
            let (by_address, by_connection) = self.last_turns(waiting.ticket.asker);
            let age = self.arrivals.wrapping_sub(waiting.arrival);
            let rank = (by_address, by_connection, u32::MAX - age);
            if best.is_none_or(|(other, _)| rank < other) {
                best = Some((rank, index));
            }
        }
        let Some((_, index)) = best else {
            return Next::Empty;
        };
        let Waiting { order, ticket, .. } = self.waiting.remove(index);
        self.note_turn(ticket.asker);
        self.note_class(class, present);
        Next::Serve(order, ticket)
    }

    /// The orders that may share a transaction with the one served with `leader`: reads of its unit before which no write to
    /// that unit waits.
    pub fn companions(&self, leader: &Ticket) -> impl DoubleEndedIterator<Item = &T> {
        self.companion_places(leader).map(|(_, waiting)| &waiting.order)
    }

    /// Takes out the last one of the [companions](PortQueue::companions) that `joins`.
    pub fn companion(&mut self, leader: &Ticket, joins: impl Fn(&T) -> bool) -> Option<T> {
        let last = self.companion_places(leader).rev().find(|(_, waiting)| joins(&waiting.order));
        let (index, _) = last?;
        Some(self.waiting.remove(index).order)
    }

    fn companion_places(&self, leader: &Ticket) -> impl DoubleEndedIterator<Item = (usize, &Waiting<T>)> {
        let Ticket { unit, access, .. } = *leader;
        let before = match access {
            Access::SharedRead => {
                self.waiting.iter().take_while(|waiting| !waiting.ticket.writes_to(unit)).count()
            }
            Access::Read | Access::Write => 0,
        };
        let may_share = move |ticket: &Ticket| ticket.access == Access::SharedRead && ticket.unit == unit;
        let first = self.waiting.get(..before).unwrap_or(&[]);
        first.iter().enumerate().filter(move |(_, waiting)| may_share(&waiting.ticket))
    }

    /// Counts a turn of `asker`, who was served along with another one.
    pub fn charge(&mut self, asker: Asker) {
        self.note_turn(asker);
    }

    /// Puts an order back that has not been carried out after all, in front of all that wait: nothing that came after it may
    /// go before it, such as a write. Gives it back when there is no room any more.
    pub fn put_back(&mut self, order: T, ticket: Ticket) -> Option<T> {
        let oldest = self.waiting.first().map(|waiting| waiting.arrival.wrapping_sub(1));
        let arrival = oldest.unwrap_or(self.arrivals);
        let refused = self.waiting.insert(0, Waiting { order, ticket, arrival });
        refused.err().map(|refused| refused.order)
    }

    /// Whether a write to `unit` waits.
    pub fn writes_to(&self, unit: u8) -> bool {
        self.waiting.iter().any(|waiting| waiting.ticket.writes_to(unit))
    }

    /// Takes out one order for which `unwanted` gives a reason, with the reason.
    pub fn take_if<R>(&mut self, unwanted: impl Fn(&T, &Ticket) -> Option<R>) -> Option<(T, R)> {
        let found = self.waiting.iter().enumerate();
        let (index, reason) = found
            .filter_map(|(index, waiting)| Some((index, unwanted(&waiting.order, &waiting.ticket)?)))
            .next()?;
        Some((self.waiting.remove(index).order, reason))
    }

    /// The earliest deadline of all that wait.
    pub fn first_deadline(&self) -> Option<Instant> {
        self.waiting.iter().map(|waiting| waiting.ticket.deadline).min()
    }

    /// The class to serve of those `present`: the highest, unless a lower one was passed over too often.
    fn class(&self, present: [bool; 3]) -> Option<usize> {
        const NORMAL: usize = Priority::Normal as usize;
        const LOW: usize = Priority::Low as usize;
        let highest = present.iter().position(|present| *present)?;
        let overdue =
            |class: usize, bound: u8| class > highest && present[class] && self.passed[class] >= bound;
        // A sparse high class is not held up by an overdue low one: only normal orders are, or a high flood.
        let low_bound = if highest == NORMAL { PASSED_OVER_MAX } else { 2 * PASSED_OVER_MAX };
        if overdue(LOW, low_bound) {
            Some(LOW)
        } else if overdue(NORMAL, PASSED_OVER_MAX) {
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

    /// The last turns of the asker's address and of the asker itself; 0: none remembered.
    fn last_turns(&self, asker: Asker) -> (u32, u32) {
        self.served.iter().filter(|served| served.asker.address == asker.address).fold(
            (0, 0),
            |turns, served| {
                let same = served.asker.connection == asker.connection;
                (turns.0.max(served.turn), if same { served.turn } else { turns.1 })
            },
        )
    }

    fn note_turn(&mut self, asker: Asker) {
        match self.turns.checked_add(1) {
            Some(turns) => self.turns = turns,
            None => {
                // Once in four thousand million turns everybody starts afresh.
                self.served.clear();
                self.turns = 1;
            }
        }
        let turn = self.turns;
        if let Some(served) = self.served.iter_mut().find(|served| served.asker == asker) {
            served.turn = turn;
            return;
        }
        if self.served.is_full() {
            // The one served longest ago ranks like one never served, so it may be forgotten.
            let oldest = self.served.iter().enumerate().min_by_key(|(_, served)| served.turn);
            if let Some((index, _)) = oldest {
                self.served.swap_remove(index);
            }
        }
        // There is room now.
        let _ = self.served.push(Served { asker, turn });
    }

    /// The newest order of the address that has most of them, if that is more than `newcomer`'s would have.
    fn crowder(&self, newcomer: Asker) -> Option<usize> {
        let count =
            |address| self.waiting.iter().filter(|other| other.ticket.asker.address == address).count();
        let crowd = self.waiting.iter().map(|waiting| count(waiting.ticket.asker.address)).max()?;
        if crowd > count(newcomer.address) + 1 {
            return self.waiting.iter().rposition(|waiting| count(waiting.ticket.asker.address) == crowd);
        }
        // Within an address the same holds of its connections.
        let own = |asker| self.waiting.iter().filter(|other| other.ticket.asker == asker).count();
        let of_address =
            || self.waiting.iter().filter(|other| other.ticket.asker.address == newcomer.address);
        let crowd = of_address().map(|waiting| own(waiting.ticket.asker)).max()?;
        if crowd <= own(newcomer) + 1 {
            return None;
        }
        self.waiting.iter().rposition(|waiting| {
            waiting.ticket.asker.address == newcomer.address && own(waiting.ticket.asker) == crowd
        })
    }
}

impl<T> Default for PortQueue<T> {
    fn default() -> Self {
        Self::new()
    }
}
