//! The lines of the audit trail and what is counted instead: pure, with time as a value.
//!
//! Changes and refusals have a ring each, so that no flood of refusals pushes out a change. Lines of both have consecutive numbers: who
//! reads them in order sees by a gap how many were pushed out before.

use core::net::IpAddr;

use embassy_time::{Duration, Instant};
use heapless::{String, Vec};

use super::ring::{Entry, Ring};
use super::topic::Topic;
use crate::settings::{LINE_BYTES_MAX, PORTS_MAX, PortId, USERS};

/// Longest text of a line in bytes: a line of settings, and who typed it. Longer ones end in `...`.
pub const AUDIT_BYTES_MAX: usize = LINE_BYTES_MAX + 100;

/// Bytes of each ring. A line of a change has about 100.
const RING_BYTES: usize = if USERS { 16 * 1024 } else { 0 };

/// Repeated refusals are counted for this time, then told by their number.
pub const COUNTED_FOR: Duration = Duration::from_secs(60);

/// Topics and ports that are counted at a time: more than there are ports and topics of theirs, and consoles.
const TALLIES_MAX: usize = if USERS { 4 * PORTS_MAX + 4 } else { 0 };

/// A line of the audit trail.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AuditLine {
    /// Consecutive, from 1.
    pub number: u32,
    /// When it was written.
    pub at: Instant,
    /// What it is about.
    pub topic: Topic,
    /// Who, a tab, and what.
    pub text: String<AUDIT_BYTES_MAX>,
}

impl From<Entry<'_>> for AuditLine {
    fn from(Entry { number, at, topic, text }: Entry<'_>) -> Self {
        Self { number, at, topic, text: String::try_from(text).unwrap_or_default() }
    }
}

/// Refusals of one kind, of which the first are told and the others counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tally {
    pub(super) topic: Topic,
    pub(super) port: Option<PortId>,
    began: Instant,
    told: u32,
    pub(super) counted: u32,
    /// Whose the last one was.
    pub(super) last: Option<IpAddr>,
}

/// The trail.
pub(crate) struct Trail {
    /// The number of the last line.
    number: u32,
    changes: Ring<RING_BYTES>,
    refusals: Ring<RING_BYTES>,
    tallies: Vec<Tally, TALLIES_MAX>,
}

impl Trail {
    pub(crate) const fn new() -> Self {
        Self { number: 0, changes: Ring::new(), refusals: Ring::new(), tallies: Vec::new() }
    }

    /// Appends a line.
    pub(super) fn push(&mut self, at: Instant, topic: Topic, text: &str) {
        self.number += 1;
        let entry = Entry { number: self.number, at, topic, text };
        if topic.is_refusal() { self.refusals.push(entry) } else { self.changes.push(entry) }
    }

    /// The number of the last line.
    pub(super) fn last(&self) -> u32 {
        self.number
    }

    /// The first line behind number `seen`.
    pub(super) fn after(&self, seen: u32) -> Option<AuditLine> {
        self.entries().find(|entry| entry.number > seen).map(AuditLine::from)
    }

    /// Line `nth` of those that are there, oldest first.
    pub(super) fn nth(&self, nth: usize) -> Option<AuditLine> {
        self.entries().nth(nth).map(AuditLine::from)
    }

    /// Both rings in order.
    fn entries(&self) -> impl Iterator<Item = Entry<'_>> {
        let (mut changes, mut refusals) =
            (self.changes.entries().peekable(), self.refusals.entries().peekable());
        core::iter::from_fn(move || match (changes.peek(), refusals.peek()) {
            (Some(change), Some(refusal)) if change.number < refusal.number => changes.next(),
            (_, Some(_)) => refusals.next(),
            (_, None) => changes.next(),
        })
    }

    /// Notes a refusal; returns whether it gets a line of its own.
    pub(super) fn refused(
        &mut self,
        now: Instant,
        topic: Topic,
        port: Option<PortId>,
        last: Option<IpAddr>,
    ) -> bool {
        let known = self.tallies.iter_mut().find(|tally| tally.topic == topic && tally.port == port);
        match known {
            Some(tally) if tally.told >= topic.told_max() => {
                tally.counted = tally.counted.saturating_add(1);
                tally.last = last;
                false
            }
            Some(tally) => {
                tally.told += 1;
                true
            }
            // There is room for all.
            None => self.tallies.push(Tally { topic, port, began: now, told: 1, counted: 0, last }).is_ok(),
        }
    }

    /// The next tally whose time is over and that has counted something; those that have not are forgotten.
    pub(super) fn due(&mut self, now: Instant) -> Option<Tally> {
        let is_over = |tally: &Tally| tally.began + COUNTED_FOR <= now;
        self.tallies.retain(|tally| !is_over(tally) || tally.counted > 0);
        let over = self.tallies.iter_mut().find(|tally| is_over(tally))?;
        let due = *over;
        // A flood that goes on gets one line in an interval.
        (over.began, over.counted) = (now, 0);
        Some(due)
    }

    /// When the next tally is due.
    pub(super) fn next_due(&self) -> Option<Instant> {
        self.tallies.iter().map(|tally| tally.began + COUNTED_FOR).min()
    }
}
