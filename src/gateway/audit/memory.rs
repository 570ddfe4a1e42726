//! The memory of the audit trail, which a board may keep over a reset.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;

use super::line::AuditLine;
use super::ring::{Entry, Ring};
use super::stamp::Stamp;
use super::topic::Topic;
use crate::settings::AUDIT;

/// Bytes of each ring. A line of a change has about 100.
const RING_BYTES: usize = match (AUDIT, cfg!(feature = "small")) {
    (false, _) => 0,
    (true, true) => 4_084,
    (true, false) => 16 * 1024,
};

/// The lines of the audit trail.
///
/// Any content is valid, also a random one. A board may have it in memory that neither a reset nor the start-up code clears; then it calls
/// [`Gateway::audit_start`](crate::gateway::Gateway::audit_start).
#[repr(C)]
pub struct AuditMemory(Mutex<CriticalSectionRawMutex, Rings>);

impl AuditMemory {
    /// Without lines.
    pub const fn new() -> Self {
        Self(Mutex::new(Rings { changes: Ring::new(), refusals: Ring::new(), sent: Cell::new(0) }))
    }

    pub(super) fn rings<R>(&self, f: impl FnOnce(&Rings) -> R) -> R {
        self.0.lock(f)
    }
}

/// Changes and refusals have a ring each, so that no flood of refusals pushes out a change. Lines of both have consecutive numbers: who
/// reads them in order sees by a gap how many were pushed out before.
#[repr(C)]
pub(super) struct Rings {
    changes: Ring<RING_BYTES>,
    refusals: Ring<RING_BYTES>,
    /// The number of the last line that a syslog server was sent.
    pub(super) sent: Cell<u32>,
}

impl Rings {
    /// Keeps what is whole; returns the number of the last line.
    pub(super) fn resume(&self) -> u32 {
        let last = self.changes.resume().max(self.refusals.resume());
        self.sent.set(self.sent.get().min(last));
        last
    }

    pub(super) fn push(&self, number: u32, stamp: Stamp, topic: Topic, text: &str) {
        if topic.is_refusal() {
            self.refusals.push(number, stamp, topic, text);
        } else {
            self.changes.push(number, stamp, topic, text);
        }
    }

    /// [`Ring::restamp`] of both.
    pub(super) fn restamp(&self, first: u32, other: impl Fn(Stamp) -> Stamp) {
        self.changes.restamp(first, &other);
        self.refusals.restamp(first, &other);
    }

    /// Both rings in order.
    pub(super) fn entries(&self) -> impl Iterator<Item = Entry> {
        let (mut changes, mut refusals) =
            (self.changes.entries().peekable(), self.refusals.entries().peekable());
        core::iter::from_fn(move || match (changes.peek(), refusals.peek()) {
            (Some(change), Some(refusal)) if change.number < refusal.number => changes.next(),
            (_, Some(_)) => refusals.next(),
            (_, None) => changes.next(),
        })
    }

    /// A line with its text.
    pub(super) fn line(&self, entry: Entry) -> AuditLine {
        let Entry { number, stamp, topic, .. } = entry;
        let text = if topic.is_refusal() { self.refusals.text(&entry) } else { self.changes.text(&entry) };
        AuditLine { number, stamp, topic, text }
    }
}
