//! The health of the units behind a client-side port. Pure, with time as a value.
//!
//! A unit that may still respond to earlier requests is *out of step* ([`outstanding`](crate::gateway::outstanding)):
//! [`Units::step`] tells whether a request may be sent as it is, or which proof goes first. A unit that left several requests in a
//! row without response is *down*: its requests fail at once, except for a probe after 1, 2, 4 ... 30 s, so that a dead unit does
//! not slow the others. Unanswered proofs back off likewise. For a unit that refused a combined read, or did not respond to it,
//! reads are not combined for a while.

mod in_step;
mod unit;

use core::ops::Range;

use embassy_time::{Duration, Instant};
use heapless::Vec;

use self::unit::{IGNORED_MAX, IGNORED_RETRY, NO_READ, Read, TRIED_MAX};

pub use self::unit::{LINE_ERRORS, PROBE_FIRST, PROBE_LONGEST, Unit};
use crate::gateway::outstanding::{Match, Outstanding, Purpose, Settled, Shape};
use crate::modbus::pdu::function::{READ_COILS, READ_INPUT_REGISTERS};
use crate::settings::{PORTS_MAX, PortId, Proof};
use crate::stats::Event;

/// When a unit may be asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ready {
    /// Now.
    Now,
    /// At this time.
    At(Instant),
    /// By another connection.
    Elsewhere,
}

/// Units stored per port: as many as servers, and more than an RS-485 segment can have. When full, the least active healthy one is
/// forgotten. The feature `small` stores fewer.
pub const UNITS_MAX: usize = if cfg!(feature = "small") { 16 } else { 64 };
/// Units stored for all ports together, since few ports use their maximum: see [`AllUnits`].
pub const ALL_UNITS_MAX: usize = if cfg!(feature = "small") { 48 } else { 256 };

/// How long reads of a unit are not combined after it refused a combined read.
pub const COMBINE_PAUSE: Duration = Duration::from_secs(60);

/// Whether a unit may be asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gate {
    /// It may be asked, now or later.
    Open(Ready),
    /// It is down, and no probe is due.
    Down,
}

/// What may be sent to a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// The request itself.
    Direct,
    /// This proof first: its response shows that no earlier one is still to come.
    Prove(Read, Purpose),
    /// Nothing until the unit's gate opens.
    Wait,
}

/// How a port proves that a unit is in step.
#[derive(Debug, Clone, Copy)]
pub struct Care {
    /// The kind of proof.
    pub proof: Proof,
    /// How late a response may be, where there is no proof.
    pub late_window: Duration,
}

/// The state of a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// It responds.
    Up,
    /// It may still respond to earlier requests.
    OutOfStep,
    /// It is not asked for a while.
    Held,
    /// Its requests fail at once.
    Down,
}

/// The units of all ports, in one array, grouped by port.
///
/// When it is full, the least active healthy unit of the port with the most units is forgotten, so that no port displaces the units
/// of ports with few.
pub struct AllUnits {
    /// Port by port, each in order of first request.
    units: Vec<Unit, ALL_UNITS_MAX>,
    ports: [List; PORTS_MAX],
    outstanding: Outstanding,
}

/// A port's part of the array.
#[derive(Clone, Copy)]
struct List {
    first: u16,
    /// Index after the last one.
    end: u16,
    /// One of its units may be held or down.
    needs_check: bool,
    frozen: bool,
}

impl List {
    const EMPTY: Self = Self { first: 0, end: 0, needs_check: false, frozen: false };

    fn slots(self) -> Range<usize> {
        self.first.into()..self.end.into()
    }
}

impl AllUnits {
    /// Without units.
    pub const fn new() -> Self {
        Self { units: Vec::new(), ports: [List::EMPTY; PORTS_MAX], outstanding: Outstanding::new() }
    }

    /// The units of `port`.
    pub fn of(&mut self, port: PortId) -> Units<'_> {
        Units { all: self, port: port.index() }
    }

    // Not inlined: it is asked for in many places.
    #[inline(never)]
    fn list(&self, port: usize) -> List {
        self.ports.get(port).copied().unwrap_or(List::EMPTY)
    }

    /// Removes the unit at `slot`, which belongs to `port`.
    fn remove(&mut self, port: usize, slot: usize) {
        self.units.remove(slot);
        for (other, list) in self.ports.iter_mut().enumerate() {
            list.first -= u16::from(other > port);
            list.end -= u16::from(other >= port);
        }
    }

    /// Appends `id` to the units of `port`, and returns its index.
    fn insert(&mut self, port: usize, id: u8) -> Option<usize> {
        let slot = self.list(port).slots().end;
        self.units.insert(slot, Unit::new(id)).ok()?;
        for (other, list) in self.ports.iter_mut().enumerate() {
            list.first += u16::from(other > port);
            list.end += u16::from(other >= port);
        }
        Some(slot)
    }

    /// Forgets the least active healthy unit of `port`.
    fn forget_one(&mut self, port: usize) {
        let quietness = |slot: &usize| {
            let unit = self.units.get(*slot)?;
            Some((unit.is_down, unit.held_until, unit.requests))
        };
        if let Some(quietest) = self.list(port).slots().min_by_key(quietness) {
            self.remove(port, quietest);
        }
    }
}

/// The units of one port.
pub struct Units<'u> {
    all: &'u mut AllUnits,
    port: usize,
}

impl Units<'_> {
    /// The known units in order of first request.
    pub fn iter(&self) -> impl Iterator<Item = &Unit> {
        self.all.units.get(self.list().slots()).unwrap_or(&[]).iter()
    }

    fn list(&self) -> List {
        self.all.list(self.port)
    }

    fn find(&self, id: u8) -> Option<&Unit> {
        self.iter().find(|unit| unit.id == id)
    }

    /// Forgets everything except what is outstanding.
    pub fn clear(&mut self) {
        for slot in self.list().slots().rev() {
            self.all.remove(self.port, slot);
        }
    }

    /// While `frozen`, nothing is learned or proved: a scan asks many units that do not exist.
    pub fn freeze(&mut self, frozen: bool) {
        self.all.ports.get_mut(self.port).into_iter().for_each(|list| list.frozen = frozen);
    }

    /// Whether `id` may be asked at `now`.
    pub fn gate(&self, id: u8, now: Instant) -> Gate {
        match self.find(id) {
            Some(unit) if unit.held_until > now && unit.is_down => Gate::Down,
            Some(unit) if unit.held_until > now => Gate::Open(Ready::At(unit.held_until)),
            _ => Gate::Open(Ready::Now),
        }
    }

    /// When a requester with its own back-off may ask `id`, even if it is down: once no late response can arrive.
    pub fn attempt(&self, id: u8, now: Instant) -> Ready {
        match self.find(id) {
            Some(unit) if unit.waited && unit.held_until > now => Ready::At(unit.held_until),
            _ => Ready::Now,
        }
    }

    /// Whether a unit may be held or down. Usually none is, which avoids checking each.
    pub fn needs_check(&self) -> bool {
        self.list().needs_check
    }

    /// Whether every unit may be asked at `now`, and none is down.
    pub fn all_healthy(&mut self, now: Instant) -> bool {
        let needs_check =
            self.needs_check() && self.iter().any(|unit| unit.held_until > now || unit.is_down());
        self.set_needs_check(needs_check);
        !needs_check
    }

    fn set_needs_check(&mut self, needs_check: bool) {
        self.all.ports.get_mut(self.port).into_iter().for_each(|list| list.needs_check = needs_check);
    }

    /// Whether `id` is down, even if a probe is due.
    pub fn is_down(&self, id: u8) -> bool {
        self.find(id).is_some_and(Unit::is_down)
    }

    /// Whether reads of `id` may be combined at `now`.
    pub fn combines(&self, id: u8, now: Instant) -> bool {
        self.find(id).is_none_or(|unit| unit.combine_after <= now)
    }

    /// Records that `id` refused a combined read.
    pub fn refused_combined(&mut self, id: u8, now: Instant) {
        if let Some(unit) = self.entry(id) {
            unit.combine_after = now + COMBINE_PAUSE;
        }
    }

    /// Records that a request is sent to `id`, whose responses carry transaction ids: see [`sent`](Self::sent) for others.
    pub fn asked(&mut self, id: u8) {
        self.entry(id).into_iter().for_each(Unit::asked);
    }

    /// Records that `id` responded `took` after the end of the request.
    pub fn answered(&mut self, id: u8, took: Duration, exception: bool) {
        if let Some(unit) = self.entry(id) {
            unit.responses = unit.responses.wrapping_add(1);
            unit.exceptions = unit.exceptions.wrapping_add(u32::from(exception));
            unit.took_us = u32::try_from(took.as_micros()).unwrap_or(u32::MAX);
            unit.times.add(unit.took_us);
            unit.alive();
            (unit.open, unit.late, unit.hurried) = (false, 0, false);
        }
    }

    /// Counts `error` for `id`.
    pub fn error(&mut self, id: u8, error: Event) {
        if let Some(unit) = self.entry(id) {
            unit.count(error);
        }
    }

    /// Clears the counters; the units' health stays.
    pub fn clear_counters(&mut self) {
        let slots = self.list().slots();
        for unit in self.all.units.get_mut(slots).unwrap_or(&mut []) {
            let Unit { id, requests, responses, exceptions, timeouts, times, errors, took_us, .. } =
                Unit::new(unit.id);
            *unit = Unit { id, requests, responses, exceptions, timeouts, times, errors, took_us, ..*unit };
        }
    }

    /// Records that `id` responded, so it is alive, but the response was corrupt by `error`.
    pub fn corrupt(&mut self, id: u8, error: Event) {
        self.timed_out_while_frozen(id);
        if let Some(unit) = self.entry(id) {
            unit.count(error);
            unit.open = false;
            unit.alive();
        }
    }

    /// Records that `id` did not respond; after `down_after` times in a row (0: never) it is down. Returns whether nothing at all
    /// was received.
    pub fn timed_out(&mut self, id: u8, now: Instant, down_after: u8) -> bool {
        self.set_needs_check(true);
        self.timed_out_while_frozen(id);
        let Some(unit) = self.entry(id) else { return false };
        let silent = !unit.disturbed;
        if silent {
            unit.count(Event::Silent);
        }
        unit.open = false;
        unit.timeouts = unit.timeouts.wrapping_add(1);
        // Some devices do not respond to reads that are too long for them.
        unit.combine_after = now + COMBINE_PAUSE;
        unit.unanswered(now, down_after);
        silent
    }

    /// While frozen nothing is recorded, so it is unknown what `id` may still respond to.
    fn timed_out_while_frozen(&mut self, id: u8) {
        if self.list().frozen {
            self.sent_in_part(id);
        }
    }

    /// The entry of `id`, added if necessary; none while frozen.
    fn entry(&mut self, id: u8) -> Option<&mut Unit> {
        let list = self.list();
        if list.frozen {
            return None;
        }
        let known = self.iter().position(|unit| unit.id == id);
        let slot = match known {
            Some(known) => list.slots().start + known,
            None => self.remember(id)?,
        };
        self.all.units.get_mut(slot)
    }

    /// Adds an entry for `id`.
    fn remember(&mut self, id: u8) -> Option<usize> {
        if self.list().slots().len() >= UNITS_MAX {
            self.all.forget_one(self.port);
        } else if self.all.units.is_full() {
            let most = (0..PORTS_MAX).max_by_key(|port| self.all.list(*port).slots().len());
            self.all.forget_one(most.unwrap_or(self.port));
        }
        self.all.insert(self.port, id)
    }
}
