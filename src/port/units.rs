//! The health of the units behind a client-side port: pure, with time as a value.
//!
//! A unit that gave no answer is *held* for the late-reply window: its answer may still come, and must not be taken
//! for the answer to the next request. A unit that timed out several times in a row is *down*: its requests fail at
//! once, and one in a while goes through as a probe, 1, 2, 4 ... 30 s apart, so that a dead unit does not slow the
//! living ones. A unit that refused a joined read, or gave no answer, is asked for less at a time for a while.

use embassy_time::{Duration, Instant};
use heapless::Vec;

use crate::port::answer_times::AnswerTimes;
use crate::port::queue::Ready;
use crate::stats::Event;

/// Units remembered at one port: the loads that an RS-485 segment carries. The quietest healthy one is forgotten
/// when another one comes. The feature `small` remembers half as many.
pub const UNITS_MAX: usize = if cfg!(feature = "small") { 16 } else { 32 };
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
    /// Whether requests fail at once.
    pub down: bool,
    /// No request before this time: a late answer may come, or the next probe is not due.
    pub held_until: Instant,
    /// The late answer may come until then, whatever is due.
    late_until: Instant,
    probe_after_ms: u32,
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
            down: false,
            held_until: Instant::MIN,
            late_until: Instant::MIN,
            probe_after_ms: PROBE_FIRST.as_millis() as u32,
            join_after: Instant::MIN,
        }
    }
}

/// The units of one port.
#[derive(Default)]
pub struct Units {
    known: Vec<Unit, UNITS_MAX>,
    frozen: bool,
}

impl Units {
    /// None known.
    pub const fn new() -> Self {
        Self { known: Vec::new(), frozen: false }
    }

    /// The known units in the order of their first request.
    pub fn iter(&self) -> impl Iterator<Item = &Unit> {
        self.known.iter()
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.known.clear();
    }

    /// While `frozen`, nothing is learned: who looks for units asks many that are not there.
    pub fn freeze(&mut self, frozen: bool) {
        self.frozen = frozen;
    }

    /// Whether `id` may be asked at `now`.
    pub fn gate(&self, id: u8, now: Instant) -> Gate {
        match self.known.iter().find(|unit| unit.id == id) {
            Some(unit) if unit.held_until > now && unit.down => Gate::Down,
            Some(unit) if unit.held_until > now => Gate::Open(Ready::At(unit.held_until)),
            _ => Gate::Open(Ready::Now),
        }
    }

    /// When `id` may be asked by somebody who spares units that are down by himself: as soon as no late answer can come.
    pub fn attempt(&self, id: u8, now: Instant) -> Ready {
        match self.known.iter().find(|unit| unit.id == id) {
            Some(unit) if unit.late_until > now => Ready::At(unit.late_until),
            _ => Ready::Now,
        }
    }

    /// Whether every unit may be asked at `now`, and none counts as down: mostly none has to be looked at by itself.
    pub fn all_well(&self, now: Instant) -> bool {
        self.known.iter().all(|unit| unit.held_until <= now && !unit.down)
    }

    /// Whether `id` counts as down, whatever is due.
    pub fn is_down(&self, id: u8) -> bool {
        self.known.iter().any(|unit| unit.id == id && unit.down)
    }

    /// Whether reads of `id` may be joined at `now`.
    pub fn joins(&self, id: u8, now: Instant) -> bool {
        !self.known.iter().any(|unit| unit.id == id && unit.join_after > now)
    }

    /// `id` refused a joined read.
    pub fn refused_join(&mut self, id: u8, now: Instant) {
        self.entry(id, |unit| unit.join_after = now + JOIN_PAUSE);
    }

    /// A request to `id` is sent.
    pub fn asked(&mut self, id: u8) {
        self.entry(id, |unit| {
            unit.requests = unit.requests.wrapping_add(1);
            unit.disturbed = false;
        });
    }

    /// `id` answered `took` after the request's end.
    pub fn answered(&mut self, id: u8, took: Duration, exception: bool) {
        self.entry(id, |unit| {
            unit.answers = unit.answers.wrapping_add(1);
            unit.exceptions = unit.exceptions.wrapping_add(u32::from(exception));
            unit.took_us = u32::try_from(took.as_micros()).unwrap_or(u32::MAX);
            unit.times.add(unit.took_us);
            unit.alive();
        });
    }

    /// Counts `trouble` with `id`.
    pub fn trouble(&mut self, id: u8, trouble: Event) {
        self.entry(id, |unit| unit.count(trouble));
    }

    /// Whether an answer of `id` would be a late one at `now`.
    pub fn is_late(&self, id: u8, now: Instant) -> bool {
        self.known.iter().any(|unit| unit.id == id && unit.late_until > now)
    }

    /// Sets what was counted to zero; the units' health stays.
    pub fn clear_counters(&mut self) {
        for unit in &mut self.known {
            let Unit { silent, down, held_until, late_until, probe_after_ms, join_after, .. } = *unit;
            let health = Unit {
                silent,
                down,
                held_until,
                late_until,
                probe_after_ms,
                join_after,
                ..Unit::new(unit.id)
            };
            *unit = health;
        }
    }

    /// `id` answered, but the answer was damaged on its way, by `trouble`: it is alive.
    pub fn damaged(&mut self, id: u8, trouble: Event) {
        self.entry(id, |unit| {
            unit.count(trouble);
            unit.alive();
        });
    }

    /// `id` gave no answer. It is held for `window`; after `down_after` such in a row (0: never) it is down. Says whether
    /// nothing at all was heard.
    pub fn timed_out(&mut self, id: u8, now: Instant, window: Duration, down_after: u8) -> bool {
        let mut silent = false;
        self.entry(id, |unit| {
            silent = !unit.disturbed;
            if silent {
                unit.count(Event::Silent);
            }
            unit.timeouts = unit.timeouts.wrapping_add(1);
            unit.silent = unit.silent.saturating_add(1);
            unit.late_until = now + window;
            // There are devices that do not answer what is too much for them.
            unit.join_after = now + JOIN_PAUSE;
            if unit.down && unit.held_until > now {
                // It was asked several things at a time, and the first time-out of them has said so already.
                return;
            }
            unit.held_until = now + window;
            if down_after != 0 && unit.silent >= down_after {
                unit.down = true;
                let probe_after = Duration::from_millis(unit.probe_after_ms.into());
                unit.held_until = now + window.max(probe_after);
                unit.probe_after_ms = (probe_after * 2).min(PROBE_LONGEST).as_millis() as u32;
            }
        });
        silent
    }

    /// `id` is held for `window`: an answer that nobody waits for may come.
    pub fn hold(&mut self, id: u8, now: Instant, window: Duration) {
        self.entry(id, |unit| {
            unit.held_until = unit.held_until.max(now + window);
            unit.late_until = unit.late_until.max(now + window);
        });
    }

    fn entry(&mut self, id: u8, change: impl FnOnce(&mut Unit)) {
        if self.frozen {
            return;
        }
        let known = self.known.iter().position(|unit| unit.id == id);
        let index = known.unwrap_or_else(|| {
            if self.known.is_full() {
                let quietest = |(_, unit): &(usize, &Unit)| (unit.down, unit.held_until, unit.requests);
                let forgotten =
                    self.known.iter().enumerate().min_by_key(quietest).map_or(0, |(index, _)| index);
                self.known.remove(forgotten);
            }
            // There is room now.
            let _ = self.known.push(Unit::new(id));
            self.known.len() - 1
        });
        if let Some(unit) = self.known.get_mut(index) {
            change(unit);
        }
    }
}

impl Unit {
    /// The troubles that there were, and how often.
    pub fn troubles(&self) -> impl Iterator<Item = (Event, u16)> {
        TROUBLES.into_iter().zip(self.troubles).filter(|(_, count)| *count > 0)
    }

    /// How often there was `trouble`.
    pub fn trouble(&self, trouble: Event) -> u16 {
        self.troubles().find(|(known, _)| *known == trouble).map_or(0, |(_, count)| count)
    }

    fn count(&mut self, trouble: Event) {
        self.disturbed = true;
        let counters = TROUBLES.into_iter().zip(&mut self.troubles);
        for (_, count) in counters.filter(|(known, _)| *known == trouble) {
            *count = count.saturating_add(1);
        }
    }

    fn alive(&mut self) {
        self.silent = 0;
        self.down = false;
        // It need not wait for a probe any more.
        self.held_until = self.held_until.min(self.late_until);
        self.probe_after_ms = PROBE_FIRST.as_millis() as u32;
    }
}
