//! The health of the units behind a client-side port: pure, with time as a value.
//!
//! A unit that gave no answer is *held* for the late-reply window: its answer may still come, and must not be taken
//! for the answer to the next request. A unit that timed out several times in a row is *down*: its requests fail at
//! once, and one in a while goes through as a probe, 1, 2, 4 ... 30 s apart, so that a dead unit does not slow the
//! living ones. A unit that refused a joined read, or gave no answer, is asked for less at a time for a while.

use core::ops::Range;

use embassy_time::{Duration, Instant};
use heapless::Vec;

use crate::config::{PORTS_MAX, PortId};
use crate::port::answer_times::AnswerTimes;
use crate::port::queue::Ready;
use crate::stats::Event;

/// Units remembered at one port: the loads that an RS-485 segment carries. The quietest healthy one is forgotten
/// when another one comes. The feature `small` remembers half as many.
pub const UNITS_MAX: usize = if cfg!(feature = "small") { 16 } else { 32 };
/// Units remembered at all ports together, since few ports have as many as they may: see [`AllUnits`].
pub const ALL_UNITS_MAX: usize = if cfg!(feature = "small") { 64 } else { 256 };
/// First and longest pause between probes of a unit that is down.
pub const PROBE_FIRST: Duration = Duration::from_secs(1);
/// See [`PROBE_FIRST`].
pub const PROBE_LONGEST: Duration = Duration::from_secs(30);

/// How long reads are not joined that ask a unit which did not take that.
pub const JOIN_PAUSE: Duration = Duration::from_secs(60);

/// What is counted of the troubles with one unit, under the names that the port's counters have. A character's parity and framing
/// count once for each answer that they spoiled.
pub const TROUBLES: [Event; 10] = [
    Event::Silent,
    Event::BadCheck,
    Event::Short,
    Event::Parity,
    Event::Framing,
    Event::WrongUnit,
    Event::Misfit,
    Event::Late,
    Event::Echo,
    Event::Noise,
];

/// Whether a unit may be asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gate {
    /// It may be asked, now or later.
    Open(Ready),
    /// It is down, and no probe is due.
    Down,
}

/// What is known of one unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unit {
    /// Its id on this port's side.
    pub id: u8,
    /// Requests sent, repeats included.
    pub requests: u32,
    /// Answers, exceptions included.
    pub answers: u32,
    /// Of the answers, the exceptions.
    pub exceptions: u32,
    /// Requests without an answer in time.
    pub timeouts: u32,
    /// How long answers take.
    pub times: AnswerTimes,
    /// By the places in [`TROUBLES`]; a counter that is full stays so.
    troubles: [u16; TROUBLES.len()],
    /// Since the last request something was heard that is no answer to it.
    disturbed: bool,
    /// From the end of the last request to its answer, in microseconds.
    pub took_us: u32,
    /// Time-outs since the last sign of life.
    pub silent: u8,
    /// How often it has been tried since it is down, and once more; 0: it is not.
    tried: u8,
    /// No request before this time: a late answer may come, or the next probe is not due.
    pub held_until: Instant,
    /// The late answer may come until then, whatever is due.
    late_until: Instant,
    /// Reads are not joined before this time.
    join_after: Instant,
}

impl Unit {
    const fn new(id: u8) -> Self {
        Self {
            id,
            requests: 0,
            answers: 0,
            exceptions: 0,
            timeouts: 0,
            times: AnswerTimes::new(),
            troubles: [0; TROUBLES.len()],
            disturbed: false,
            took_us: 0,
            silent: 0,
            tried: 0,
            held_until: Instant::MIN,
            late_until: Instant::MIN,
            join_after: Instant::MIN,
        }
    }
}

/// The units of all ports, in one memory, in which those of one port stand together.
///
/// When all places are taken, the quietest healthy unit of the port that has most of them is forgotten, so no port can take the
/// places of others that have few.
pub struct AllUnits {
    /// Port by port, each port's in the order of their first requests.
    units: Vec<Unit, ALL_UNITS_MAX>,
    ports: [List; PORTS_MAX],
}

/// Which units are a port's.
#[derive(Clone, Copy)]
struct List {
    first: u16,
    /// Behind the last one.
    end: u16,
    /// One of its units may be held or down.
    troubled: bool,
    frozen: bool,
}

impl List {
    const EMPTY: Self = Self { first: 0, end: 0, troubled: false, frozen: false };

    fn places(self) -> Range<usize> {
        self.first.into()..self.end.into()
    }
}

impl AllUnits {
    /// None known.
    pub const fn new() -> Self {
        Self { units: Vec::new(), ports: [List::EMPTY; PORTS_MAX] }
    }

    /// The units of `port`.
    pub fn of(&mut self, port: PortId) -> Units<'_> {
        Units { all: self, port: port.index() }
    }

    fn list(&self, port: usize) -> List {
        self.ports.get(port).copied().unwrap_or(List::EMPTY)
    }

    /// Takes the unit at `place` out, which is one of `port`.
    fn remove(&mut self, port: usize, place: usize) {
        self.units.remove(place);
        for (other, list) in self.ports.iter_mut().enumerate() {
            list.first -= u16::from(other > port);
            list.end -= u16::from(other >= port);
        }
    }

    /// Puts `id` behind the units of `port`, and gives its place.
    fn insert(&mut self, port: usize, id: u8) -> Option<usize> {
        let place = self.list(port).places().end;
        self.units.insert(place, Unit::new(id)).ok()?;
        for (other, list) in self.ports.iter_mut().enumerate() {
            list.first += u16::from(other > port);
            list.end += u16::from(other >= port);
        }
        Some(place)
    }

    /// Forgets the quietest healthy unit of `port`.
    fn forget_one(&mut self, port: usize) {
        let quietness = |place: &usize| {
            let unit = self.units.get(*place)?;
            Some((unit.is_down(), unit.held_until, unit.requests))
        };
        if let Some(quietest) = self.list(port).places().min_by_key(quietness) {
            self.remove(port, quietest);
        }
    }
}

impl Default for AllUnits {
    fn default() -> Self {
        Self::new()
    }
}

/// The units of one port.
pub struct Units<'u> {
    all: &'u mut AllUnits,
    port: usize,
}

impl Units<'_> {
    /// The known units in the order of their first request.
    pub fn iter(&self) -> impl Iterator<Item = &Unit> {
        self.all.units.get(self.list().places()).unwrap_or(&[]).iter()
    }

    fn list(&self) -> List {
        self.all.list(self.port)
    }

    fn find(&self, id: u8) -> Option<&Unit> {
        self.iter().find(|unit| unit.id == id)
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        for place in self.list().places().rev() {
            self.all.remove(self.port, place);
        }
    }

    /// While `frozen`, nothing is learned: who looks for units asks many that are not there.
    pub fn freeze(&mut self, frozen: bool) {
        self.all.ports.get_mut(self.port).into_iter().for_each(|list| list.frozen = frozen);
    }

    /// Whether `id` may be asked at `now`.
    pub fn gate(&self, id: u8, now: Instant) -> Gate {
        match self.find(id) {
            Some(unit) if unit.held_until > now && unit.is_down() => Gate::Down,
            Some(unit) if unit.held_until > now => Gate::Open(Ready::At(unit.held_until)),
            _ => Gate::Open(Ready::Now),
        }
    }

    /// When `id` may be asked by somebody who spares units that are down by himself: as soon as no late answer can come.
    pub fn attempt(&self, id: u8, now: Instant) -> Ready {
        match self.find(id) {
            Some(unit) if unit.late_until > now => Ready::At(unit.late_until),
            _ => Ready::Now,
        }
    }

    /// Whether a unit may be held or down: mostly none is, and none has to be looked at by itself.
    pub fn troubled(&self) -> bool {
        self.list().troubled
    }

    /// Whether every unit may be asked at `now`, and none counts as down.
    pub fn all_well(&mut self, now: Instant) -> bool {
        let troubled = self.troubled() && self.iter().any(|unit| unit.held_until > now || unit.is_down());
        self.set_troubled(troubled);
        !troubled
    }

    fn set_troubled(&mut self, troubled: bool) {
        self.all.ports.get_mut(self.port).into_iter().for_each(|list| list.troubled = troubled);
    }

    /// Whether `id` counts as down, whatever is due.
    pub fn is_down(&self, id: u8) -> bool {
        self.find(id).is_some_and(Unit::is_down)
    }

    /// Whether reads of `id` may be joined at `now`.
    pub fn joins(&self, id: u8, now: Instant) -> bool {
        self.find(id).is_none_or(|unit| unit.join_after <= now)
    }

    /// `id` refused a joined read.
    pub fn refused_join(&mut self, id: u8, now: Instant) {
        if let Some(unit) = self.entry(id) {
            unit.join_after = now + JOIN_PAUSE;
        }
    }

    /// A request to `id` is sent.
    pub fn asked(&mut self, id: u8) {
        if let Some(unit) = self.entry(id) {
            unit.requests = unit.requests.wrapping_add(1);
            unit.disturbed = false;
        }
    }

    /// `id` answered `took` after the request's end.
    pub fn answered(&mut self, id: u8, took: Duration, exception: bool) {
        if let Some(unit) = self.entry(id) {
            unit.answers = unit.answers.wrapping_add(1);
            unit.exceptions = unit.exceptions.wrapping_add(u32::from(exception));
            unit.took_us = u32::try_from(took.as_micros()).unwrap_or(u32::MAX);
            unit.times.add(unit.took_us);
            unit.alive();
        }
    }

    /// Counts `trouble` with `id`.
    pub fn trouble(&mut self, id: u8, trouble: Event) {
        if let Some(unit) = self.entry(id) {
            unit.count(trouble);
        }
    }

    /// Whether an answer of `id` would be a late one at `now`.
    pub fn is_late(&self, id: u8, now: Instant) -> bool {
        self.find(id).is_some_and(|unit| unit.late_until > now)
    }

    /// Sets what was counted to zero; the units' health stays.
    pub fn clear_counters(&mut self) {
        let places = self.list().places();
        for unit in self.all.units.get_mut(places).unwrap_or(&mut []) {
            let Unit { silent, tried, held_until, late_until, join_after, .. } = *unit;
            *unit = Unit { silent, tried, held_until, late_until, join_after, ..Unit::new(unit.id) };
        }
    }

    /// `id` answered, but the answer was damaged on its way, by `trouble`: it is alive.
    pub fn damaged(&mut self, id: u8, trouble: Event) {
        if let Some(unit) = self.entry(id) {
            unit.count(trouble);
            unit.alive();
        }
    }

    /// `id` gave no answer. It is held for `window`; after `down_after` such in a row (0: never) it is down. Says whether
    /// nothing at all was heard.
    pub fn timed_out(&mut self, id: u8, now: Instant, window: Duration, down_after: u8) -> bool {
        self.set_troubled(true);
        let Some(unit) = self.entry(id) else { return false };
        let silent = !unit.disturbed;
        if silent {
            unit.count(Event::Silent);
        }
        unit.timeouts = unit.timeouts.wrapping_add(1);
        unit.silent = unit.silent.saturating_add(1);
        unit.late_until = now + window;
        // There are devices that do not answer what is too much for them.
        unit.join_after = now + JOIN_PAUSE;
        if unit.is_down() && unit.held_until > now {
            // It was asked several things at a time, and the first time-out of them has said so already.
            return silent;
        }
        unit.held_until = now + window;
        if down_after != 0 && unit.silent >= down_after {
            unit.tried = unit.tried.saturating_add(1);
            unit.held_until = now + window.max(unit.probe_after());
        }
        silent
    }

    /// `id` is held for `window`: an answer that nobody waits for may come.
    pub fn hold(&mut self, id: u8, now: Instant, window: Duration) {
        self.set_troubled(true);
        if let Some(unit) = self.entry(id) {
            unit.held_until = unit.held_until.max(now + window);
            unit.late_until = unit.late_until.max(now + window);
        }
    }

    /// The unit `id`, made if it is not known yet; none while nothing is learned.
    fn entry(&mut self, id: u8) -> Option<&mut Unit> {
        let list = self.list();
        if list.frozen {
            return None;
        }
        let known = self.iter().position(|unit| unit.id == id);
        let place = match known {
            Some(known) => list.places().start + known,
            None => self.remember(id)?,
        };
        self.all.units.get_mut(place)
    }

    /// Makes a place for `id`.
    fn remember(&mut self, id: u8) -> Option<usize> {
        if self.list().places().len() >= UNITS_MAX {
            self.all.forget_one(self.port);
        } else if self.all.units.is_full() {
            let most = (0..PORTS_MAX).max_by_key(|port| self.all.list(*port).places().len());
            self.all.forget_one(most.unwrap_or(self.port));
        }
        self.all.insert(self.port, id)
    }
}

impl Unit {
    /// The troubles that there were, and how often.
    pub fn troubles(&self) -> impl Iterator<Item = (Event, u16)> {
        let counts = TROUBLES.iter().zip(&self.troubles);
        counts.map(|(trouble, count)| (*trouble, *count)).filter(|(_, count)| *count > 0)
    }

    /// How often there was `trouble`.
    pub fn trouble(&self, trouble: Event) -> u16 {
        self.troubles().find(|(known, _)| *known == trouble).map_or(0, |(_, count)| count)
    }

    fn count(&mut self, trouble: Event) {
        self.disturbed = true;
        let place = TROUBLES.iter().position(|known| *known == trouble);
        if let Some(count) = place.and_then(|place| self.troubles.get_mut(place)) {
            *count = count.saturating_add(1);
        }
    }

    /// Whether requests fail at once.
    pub fn is_down(&self) -> bool {
        self.tried > 0
    }

    /// How long after the latest try it is tried again.
    fn probe_after(&self) -> Duration {
        let doubled = self.tried.saturating_sub(1).min(8);
        (PROBE_FIRST * (1 << doubled)).min(PROBE_LONGEST)
    }

    fn alive(&mut self) {
        self.silent = 0;
        self.tried = 0;
        // It need not wait for a probe any more.
        self.held_until = self.held_until.min(self.late_until);
    }
}
