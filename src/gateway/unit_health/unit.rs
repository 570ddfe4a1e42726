//! The state of one unit.

use embassy_time::{Duration, Instant};

use crate::gateway::outstanding::{Purpose, Shape};
use crate::gateway::response_times::ResponseTimes;
use crate::stats::Event;

/// First and longest pause between probes of a unit that is down.
pub const PROBE_FIRST: Duration = Duration::from_secs(1);

/// See [`PROBE_FIRST`].
pub const PROBE_LONGEST: Duration = Duration::from_secs(30);

/// Unanswered proofs by function 8, followed by answered requests, until the unit is assumed to ignore them. Several responses in a
/// row may get lost, especially late ones, which collide with the requests sent meanwhile.
pub(super) const IGNORED_MAX: u8 = 8;

/// Unanswered proofs of any kind, after which a unit that has never answered a read gets no more of them.
pub(super) const TRIED_MAX: u8 = 3;

/// The same for a unit that has answered a read; after this many, reads are tried again where nothing else proves anything.
pub(super) const IGNORED_RETRY: u8 = 21;

/// Minimum time for further responses after a late one.
pub(super) const LATE_PAUSE: Duration = Duration::from_millis(100);

/// Late responses in a row after which the unit counts as slower than its time-out.
pub(super) const LATE_MAX: u8 = 3;

/// Reads that the unit is known to answer, of different shapes, for use as proofs.
pub(super) const READS_MAX: usize = 2;

/// A read of functions 1 to 4.
pub(super) type Read = [u8; 5];

pub(super) const NO_READ: Read = [0; 5];

/// The errors counted per unit, under the names of the port's counters. Parity and framing errors count once per corrupt
/// response.
pub const LINE_ERRORS: [Event; 11] = [
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

/// The state of one unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unit {
    /// Its id on this port's side.
    pub id: u8,
    /// Requests sent, including repeats.
    pub requests: u32,
    /// Responses, including exceptions.
    pub responses: u32,
    /// Of the responses, the exceptions.
    pub exceptions: u32,
    /// Requests without a response in time.
    pub timeouts: u32,
    /// Response times.
    pub times: ResponseTimes,
    /// Indexed as [`LINE_ERRORS`]; saturating.
    pub(super) errors: [u16; LINE_ERRORS.len()],
    /// A response is expected.
    pub(super) open: bool,
    /// Since the last request, something other than its response has been received.
    pub(super) disturbed: bool,
    /// From the end of the last request to its response, in microseconds.
    pub took_us: u32,
    /// Time-outs since the last response of any kind.
    pub silent: u8,
    /// Unanswered probes and proofs since it went down or out of step.
    pub(super) tried: u8,
    pub(super) is_down: bool,
    /// The audit trail has it as down.
    pub(super) told_down: bool,
    /// It has sent a valid frame since the last request or proof.
    pub(super) responded: bool,
    /// A late response has already shortened the wait for a probe, once since the last response in time.
    pub(super) hurried: bool,
    /// Late responses since the last one in time.
    pub(super) late: u8,
    /// Proofs by function 8 in a row that it ignored while it answered later requests.
    pub(super) ignored: u8,
    /// It has answered a proof by function 8, normally or with an exception.
    pub(super) responds_to_diagnostics: bool,
    /// The next proof is a read, if there is one.
    pub(super) by_read: bool,
    /// The late window of outstanding responses has been, or is being, waited for.
    pub(super) waited: bool,
    /// The last request was sent after waiting, without proof that the unit was in step.
    pub unproven: bool,
    /// Reads that it has answered; zeros: none.
    pub(super) reads: [Read; READS_MAX],
    /// No request before this time: the next probe is not due, or a late response may arrive.
    pub held_until: Instant,
    /// Reads are not combined before this time.
    pub(super) combine_after: Instant,
}

impl Unit {
    pub(super) const fn new(id: u8) -> Self {
        Self {
            id,
            requests: 0,
            responses: 0,
            exceptions: 0,
            timeouts: 0,
            times: ResponseTimes::new(),
            errors: [0; LINE_ERRORS.len()],
            open: false,
            disturbed: false,
            took_us: 0,
            silent: 0,
            tried: 0,
            is_down: false,
            told_down: false,
            responded: false,
            hurried: false,
            late: 0,
            ignored: 0,
            responds_to_diagnostics: false,
            by_read: false,
            waited: false,
            unproven: false,
            reads: [NO_READ; READS_MAX],
            held_until: Instant::MIN,
            combine_after: Instant::MIN,
        }
    }
}

impl Unit {
    /// The errors that occurred, with their counts.
    pub fn errors(&self) -> impl Iterator<Item = (Event, u16)> {
        let counts = LINE_ERRORS.iter().zip(&self.errors);
        counts.map(|(error, count)| (*error, *count)).filter(|(_, count)| *count > 0)
    }

    /// How often `error` occurred.
    pub fn error(&self, error: Event) -> u16 {
        self.errors().find(|(known, _)| *known == error).map_or(0, |(_, count)| count)
    }

    pub(super) fn count(&mut self, error: Event) {
        self.disturbed = true;
        let slot = LINE_ERRORS.iter().position(|known| *known == error);
        if let Some(count) = slot.and_then(|slot| self.errors.get_mut(slot)) {
            *count = count.saturating_add(1);
        }
    }

    /// Whether requests fail at once.
    pub fn is_down(&self) -> bool {
        self.is_down
    }

    /// Whether it responds, but always late.
    pub fn is_slow(&self) -> bool {
        self.late >= LATE_MAX
    }

    /// Records that a request got no response.
    pub(super) fn unanswered(&mut self, now: Instant, down_after: u8) {
        self.silent = self.silent.saturating_add(1);
        if self.is_down && self.held_until > now {
            // Several requests were in flight, and the first time-out has counted.
            return;
        }
        if down_after != 0 && self.silent >= down_after {
            self.is_down = true;
            self.back_off(now);
        }
    }

    /// Backs off: the pause to the next probe or proof grows.
    pub(super) fn back_off(&mut self, now: Instant) {
        let doubled = 1 << self.tried.min(8);
        self.tried = self.tried.saturating_add(1);
        // A lost response or two do not mean that the unit is down: begin with short pauses, so that a client that waits for a second
        // still gets its exception.
        let pause =
            if self.is_down { PROBE_FIRST * doubled } else { (LATE_PAUSE * doubled / 2).max(LATE_PAUSE) };
        self.held_until = now + pause.min(PROBE_LONGEST);
    }

    /// A request is sent to it.
    pub(super) fn asked(&mut self) {
        self.requests = self.requests.wrapping_add(1);
        self.disturbed = false;
    }

    pub(super) fn alive(&mut self) {
        self.silent = 0;
        self.tried = 0;
        self.is_down = false;
        // It need not wait for a probe any more.
        if !self.waited {
            self.held_until = Instant::MIN;
        }
    }

    /// Records a late response: the unit is alive and can be probed, after a pause unless it is `in_step`, since more may be on its
    /// way. Once the unit counts as slow, further late responses have no effect.
    pub(super) fn was_late(&mut self, purpose: Purpose, in_step: bool, now: Instant) {
        self.late = self.late.saturating_add(u8::from(purpose == Purpose::Request));
        if self.waited || self.hurried {
            return;
        }
        self.hurried = self.is_slow();
        let pause = LATE_PAUSE.max(Duration::from_micros(self.took_us.into()) * 2);
        self.held_until = if in_step { now } else { now + pause };
    }

    /// Stores `read` as answered, keeping one of another shape.
    pub(super) fn remember(&mut self, read: Read) {
        let [first, second] = &mut self.reads;
        let is_like =
            |known: &Read| *known == NO_READ || Shape::of_request(known) == Shape::of_request(&read);
        *(if is_like(first) { first } else { second }) = read;
    }
}
