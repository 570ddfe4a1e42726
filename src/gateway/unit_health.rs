//! The health of the units behind a client-side port: pure, with time as a value.
//!
//! A unit that may still answer earlier requests is *out of step* ([`outstanding`](crate::gateway::outstanding)): [`Units::step`]
//! says whether a request may be sent as it is, or what proof goes first. A unit that gave several requests in a row no answer is
//! *down*: its requests fail at once, and one in a while goes through as a probe, 1, 2, 4 ... 30 s apart, so that a dead unit
//! does not slow the living ones. So far apart are proofs, too, that get no answer. A unit that refused a joined read, or gave
//! no answer, is asked for less at a time for a while.

mod in_step;

use core::ops::Range;

use embassy_time::{Duration, Instant};
use heapless::Vec;

use crate::gateway::outstanding::{Match, Outstanding, Purpose, Settled, Shape};
use crate::gateway::response_times::AnswerTimes;
use crate::modbus::pdu::function::{READ_COILS, READ_INPUT_REGISTERS};
use crate::settings::{PORTS_MAX, PortId, Proof};
use crate::stats::Event;

/// When a unit may be asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ready {
    /// At once.
    Now,
    /// Not before this time.
    At(Instant),
    /// By somebody else.
    Elsewhere,
}

/// Units remembered at one port: the servers that it can have, and more than the loads that an RS-485 segment carries. The
/// quietest healthy one is forgotten when another one comes. The feature `small` remembers fewer.
pub const UNITS_MAX: usize = if cfg!(feature = "small") { 16 } else { 64 };
/// Units remembered at all ports together, since few ports have as many as they may: see [`AllUnits`].
pub const ALL_UNITS_MAX: usize = if cfg!(feature = "small") { 48 } else { 256 };
/// First and longest pause between probes of a unit that is down.
pub const PROBE_FIRST: Duration = Duration::from_secs(1);
/// See [`PROBE_FIRST`].
pub const PROBE_LONGEST: Duration = Duration::from_secs(30);

/// How long reads are not joined that ask a unit which did not take that.
pub const JOIN_PAUSE: Duration = Duration::from_secs(60);

/// Proofs by function 8 without an answer behind which other requests were answered, until the unit is known to ignore them. Answers
/// get lost, and late ones often several in a row: they meet the requests that are sent meanwhile.
const IGNORED_MAX: u8 = 8;
/// Proofs of any kind without an answer, until a unit that has never answered a read is not asked by them any more.
const TRIED_MAX: u8 = 3;
/// So many if it has answered one before; and after so many it is tried again all the same, where nothing else proves anything.
const IGNORED_RETRY: u8 = 21;
/// How long a unit has at least to send what is to come behind a late answer.
const LATE_PAUSE: Duration = Duration::from_millis(100);
/// Late answers in a row after which a unit is slower than its time-out.
const LATE_MAX: u8 = 3;
/// Reads that a unit is known to answer, of different shapes: a proof is one of them.
const READS_MAX: usize = 2;
/// A read of functions 1 to 4.
type Read = [u8; 5];
const NO_READ: Read = [0; 5];

/// What is counted of the troubles with one unit, under the names that the port's counters have. A character's parity and framing
/// count once for each answer that they spoiled.
pub const TROUBLES: [Event; 11] = [
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
    Event::Unsolicited,
];

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
    /// The request.
    Direct,
    /// This request first, for this purpose: its answer proves that nothing else is to come.
    Prove(Read, Purpose),
    /// Nothing before the unit's gate opens.
    Wait,
}

/// How a port treats a unit that may be out of step.
#[derive(Debug, Clone, Copy)]
pub struct Care {
    /// What proves that it is in step.
    pub proof: Proof,
    /// How long an answer may be late where nothing proves anything.
    pub late_window: Duration,
}

/// How a unit is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// It answers.
    Up,
    /// It may still answer earlier requests.
    OutOfStep,
    /// It is not asked for a while.
    Held,
    /// Its requests fail at once.
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
    /// A response is awaited.
    open: bool,
    /// Since the last request something was heard that is no answer to it.
    disturbed: bool,
    /// From the end of the last request to its answer, in microseconds.
    pub took_us: u32,
    /// Time-outs since the last sign of life.
    pub silent: u8,
    /// Probes and proofs without an answer since it is down or out of step.
    tried: u8,
    is_down: bool,
    /// Something whole has been heard of it since the last request or proof.
    heard: bool,
    /// Something was late since it answered in time: then it need not wait for the next probe.
    hurried: bool,
    /// Late answers since the last one in time.
    late: u8,
    /// Proofs by function 8 in a row that it has left unanswered while it answered what came behind them.
    ignored: u8,
    /// It has answered a proof by function 8, one way or another.
    answers_diagnostics: bool,
    /// The next proof is another one than by function 8, if there is one.
    by_read: bool,
    /// The late window of what is outstanding has been waited for, or is.
    waited: bool,
    /// Nothing proved that it was in step when it was asked last, only time.
    pub unproven: bool,
    /// Reads that it has answered; zeros: none.
    reads: [Read; READS_MAX],
    /// No request before this time: the next probe is not due, or a late answer may come.
    pub held_until: Instant,
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
            open: false,
            disturbed: false,
            took_us: 0,
            silent: 0,
            tried: 0,
            is_down: false,
            heard: false,
            hurried: false,
            late: 0,
            ignored: 0,
            answers_diagnostics: false,
            by_read: false,
            waited: false,
            unproven: false,
            reads: [NO_READ; READS_MAX],
            held_until: Instant::MIN,
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
    outstanding: Outstanding,
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
        Self { units: Vec::new(), ports: [List::EMPTY; PORTS_MAX], outstanding: Outstanding::new() }
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
            Some((unit.is_down, unit.held_until, unit.requests))
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

    /// Forgets all but what the units may still answer.
    pub fn clear(&mut self) {
        for place in self.list().places().rev() {
            self.all.remove(self.port, place);
        }
    }

    /// While `frozen`, nothing is learned, and nothing proved: who looks for units asks many that are not there.
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

    /// When `id` may be asked by somebody who spares units that are down by himself: as soon as no late answer can come.
    pub fn attempt(&self, id: u8, now: Instant) -> Ready {
        match self.find(id) {
            Some(unit) if unit.waited && unit.held_until > now => Ready::At(unit.held_until),
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
            (unit.open, unit.late, unit.hurried) = (false, 0, false);
        }
    }

    /// Counts `trouble` with `id`.
    pub fn trouble(&mut self, id: u8, trouble: Event) {
        if let Some(unit) = self.entry(id) {
            unit.count(trouble);
        }
    }

    /// Sets what was counted to zero; the units' health stays.
    pub fn clear_counters(&mut self) {
        let places = self.list().places();
        for unit in self.all.units.get_mut(places).unwrap_or(&mut []) {
            let Unit { id, requests, answers, exceptions, timeouts, times, troubles, took_us, .. } =
                Unit::new(unit.id);
            *unit = Unit { id, requests, answers, exceptions, timeouts, times, troubles, took_us, ..*unit };
        }
    }

    /// `id` answered, but the answer was damaged on its way, by `trouble`: it is alive.
    pub fn damaged(&mut self, id: u8, trouble: Event) {
        self.frozen_asked_in_vain(id);
        if let Some(unit) = self.entry(id) {
            unit.count(trouble);
            unit.open = false;
            unit.alive();
        }
    }

    /// `id` gave no answer; after `down_after` such in a row (0: never) it is down. Says whether nothing at all was heard.
    pub fn timed_out(&mut self, id: u8, now: Instant, down_after: u8) -> bool {
        self.set_troubled(true);
        self.frozen_asked_in_vain(id);
        let Some(unit) = self.entry(id) else { return false };
        let silent = !unit.disturbed;
        if silent {
            unit.count(Event::Silent);
        }
        unit.open = false;
        unit.timeouts = unit.timeouts.wrapping_add(1);
        // There are devices that do not answer what is too much for them.
        unit.join_after = now + JOIN_PAUSE;
        unit.unanswered(now, down_after);
        silent
    }

    /// While nothing is learned, it is not known either what `id` may still answer.
    fn frozen_asked_in_vain(&mut self, id: u8) {
        if self.list().frozen {
            self.sent_in_part(id);
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
        self.is_down
    }

    /// Whether its answers come, but only when their time is over.
    pub fn is_slow(&self) -> bool {
        self.late >= LATE_MAX
    }

    /// Nobody got an answer of it who asked.
    fn unanswered(&mut self, now: Instant, down_after: u8) {
        self.silent = self.silent.saturating_add(1);
        if self.is_down && self.held_until > now {
            // It was asked several things at a time, and the first time-out of them has said so already.
            return;
        }
        if down_after != 0 && self.silent >= down_after {
            self.is_down = true;
            self.back_off(now);
        }
    }

    /// The next probe or proof waits, each time for longer.
    fn back_off(&mut self, now: Instant) {
        let doubled = self.tried.min(8);
        self.tried = self.tried.saturating_add(1);
        // Where one answer was lost, another may have been: that is no reason to leave it alone for long.
        let first = if self.is_down { PROBE_FIRST } else { LATE_PAUSE };
        self.held_until = now + (first * (1 << doubled)).min(PROBE_LONGEST);
    }

    fn alive(&mut self) {
        self.silent = 0;
        self.tried = 0;
        self.is_down = false;
        // It need not wait for a probe any more.
        if !self.waited {
            self.held_until = Instant::MIN;
        }
    }

    /// Something came late: the unit lives, and can be probed, after a pause unless it is `in_step`: what else is to come may be
    /// on its way. One that is always late is not hurried each time.
    fn was_late(&mut self, purpose: Purpose, in_step: bool, now: Instant) {
        self.late = self.late.saturating_add(u8::from(purpose == Purpose::Request));
        if self.waited || self.hurried {
            return;
        }
        self.hurried = self.is_slow();
        let pause = LATE_PAUSE.max(Duration::from_micros(self.took_us.into()) * 2);
        self.held_until = if in_step { now } else { now + pause };
    }

    /// Remembers that it answers `read`, beside one of another shape.
    fn remember(&mut self, read: Read) {
        let [first, second] = &mut self.reads;
        let is_like =
            |known: &Read| *known == NO_READ || Shape::of_request(known) == Shape::of_request(&read);
        *(if is_like(first) { first } else { second }) = read;
    }
}
