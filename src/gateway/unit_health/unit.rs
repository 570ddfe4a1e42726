//! What is known of one unit.

use embassy_time::{Duration, Instant};

use crate::gateway::outstanding::{Purpose, Shape};
use crate::gateway::response_times::ResponseTimes;
use crate::stats::Event;

/// First and longest pause between probes of a unit that is down.
pub const PROBE_FIRST: Duration = Duration::from_secs(1);

/// See [`PROBE_FIRST`].
pub const PROBE_LONGEST: Duration = Duration::from_secs(30);

/// Proofs by function 8 without a response behind which other requests were answered, until the unit is known to ignore them. Answers
/// get lost, and late ones often several in a row: they meet the requests that are sent meanwhile.
pub(super) const IGNORED_MAX: u8 = 8;

/// Proofs of any kind without a response, until a unit that has never answered a read is not asked by them any more.
pub(super) const TRIED_MAX: u8 = 3;

/// So many if it has answered one before; and after so many it is tried again all the same, where nothing else proves anything.
pub(super) const IGNORED_RETRY: u8 = 21;

/// How long a unit has at least to send what is to come behind a late response.
pub(super) const LATE_PAUSE: Duration = Duration::from_millis(100);

/// Late responses in a row after which a unit is slower than its time-out.
pub(super) const LATE_MAX: u8 = 3;

/// Reads that a unit is known to answer, of different shapes: a proof is one of them.
pub(super) const READS_MAX: usize = 2;

/// A read of functions 1 to 4.
pub(super) type Read = [u8; 5];

pub(super) const NO_READ: Read = [0; 5];

/// What is counted of the troubles with one unit, under the names that the port's counters have. A character's parity and framing
/// count once for each response that they spoiled.
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

/// What is known of one unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unit {
    /// Its id on this port's side.
    pub id: u8,
    /// Requests sent, repeats included.
    pub requests: u32,
    /// Answers, exceptions included.
    pub responses: u32,
    /// Of the responses, the exceptions.
    pub exceptions: u32,
    /// Requests without a response in time.
    pub timeouts: u32,
    /// How long answers take.
    pub times: ResponseTimes,
    /// By the places in [`LINE_ERRORS`]; a counter that is full stays so.
    pub(super) errors: [u16; LINE_ERRORS.len()],
    /// A response is awaited.
    pub(super) open: bool,
    /// Since the last request something was heard that is no response to it.
    pub(super) disturbed: bool,
    /// From the end of the last request to its response, in microseconds.
    pub took_us: u32,
    /// Time-outs since the last sign of life.
    pub silent: u8,
    /// Probes and proofs without a response since it is down or out of step.
    pub(super) tried: u8,
    pub(super) is_down: bool,
    /// Something whole has been heard of it since the last request or proof.
    pub(super) responded: bool,
    /// Something was late since it answered in time: then it need not wait for the next probe.
    pub(super) hurried: bool,
    /// Late responses since the last one in time.
    pub(super) late: u8,
    /// Proofs by function 8 in a row that it has left unanswered while it answered what came behind them.
    pub(super) ignored: u8,
    /// It has answered a proof by function 8, one way or another.
    pub(super) answers_diagnostics: bool,
    /// The next proof is another one than by function 8, if there is one.
    pub(super) by_read: bool,
    /// The late window of what is outstanding has been waited for, or is.
    pub(super) waited: bool,
    /// Nothing proved that it was in step when it was asked last, only time.
    pub unproven: bool,
    /// Reads that it has answered; zeros: none.
    pub(super) reads: [Read; READS_MAX],
    /// No request before this time: the next probe is not due, or a late response may come.
    pub held_until: Instant,
    /// Reads are not joined before this time.
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
            responded: false,
            hurried: false,
            late: 0,
            ignored: 0,
            answers_diagnostics: false,
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
    /// The troubles that there were, and how often.
    pub fn errors(&self) -> impl Iterator<Item = (Event, u16)> {
        let counts = LINE_ERRORS.iter().zip(&self.errors);
        counts.map(|(error, count)| (*error, *count)).filter(|(_, count)| *count > 0)
    }

    /// How often there was `error`.
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

    /// Whether its responses come, but only when their time is over.
    pub fn is_slow(&self) -> bool {
        self.late >= LATE_MAX
    }

    /// Nobody got a response of it who asked.
    pub(super) fn unanswered(&mut self, now: Instant, down_after: u8) {
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
    pub(super) fn back_off(&mut self, now: Instant) {
        let doubled = self.tried.min(8);
        self.tried = self.tried.saturating_add(1);
        // Where one response was lost, another may have been: that is no reason to leave it alone for long.
        let first = if self.is_down { PROBE_FIRST } else { LATE_PAUSE };
        self.held_until = now + (first * (1 << doubled)).min(PROBE_LONGEST);
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

    /// Something came late: the unit lives, and can be probed, after a pause unless it is `in_step`: what else is to come may be
    /// on its way. One that is always late is not hurried each time.
    pub(super) fn was_late(&mut self, purpose: Purpose, in_step: bool, now: Instant) {
        self.late = self.late.saturating_add(u8::from(purpose == Purpose::Request));
        if self.waited || self.hurried {
            return;
        }
        self.hurried = self.is_slow();
        let pause = LATE_PAUSE.max(Duration::from_micros(self.took_us.into()) * 2);
        self.held_until = if in_step { now } else { now + pause };
    }

    /// Remembers that it answers `read`, beside one of another shape.
    pub(super) fn remember(&mut self, read: Read) {
        let [first, second] = &mut self.reads;
        let is_like =
            |known: &Read| *known == NO_READ || Shape::of_request(known) == Shape::of_request(&read);
        *(if is_like(first) { first } else { second }) = read;
    }
}
