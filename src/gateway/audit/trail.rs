//! The numbers of the lines of the audit trail, and what is counted instead of lines: pure, with time as a value.

use core::net::IpAddr;

use embassy_time::{Duration, Instant};
use heapless::Vec;

use super::memory::Rings;
use super::stamp::Stamp;
use super::topic::Topic;
use crate::settings::{AUDIT, PORTS_MAX, PortId};

/// Interval over which repeated refusals are counted, then reported as a number.
pub const COUNTED_FOR: Duration = Duration::from_secs(60);

/// Tallies kept at a time: more than all combinations of ports, consoles and their topics.
const TALLIES_MAX: usize = if AUDIT { 4 * PORTS_MAX + 4 } else { 0 };

/// Refusals of one kind: the first are reported, the others counted.
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

/// The trail, besides its lines.
pub(crate) struct Trail {
    /// The number of the last line.
    number: u32,
    /// The number of the last line of earlier runs.
    earlier: u32,
    tallies: Vec<Tally, TALLIES_MAX>,
}

impl Trail {
    pub(crate) const fn new() -> Self {
        Self { number: 0, earlier: 0, tallies: Vec::new() }
    }

    /// Continues the numbering of earlier runs.
    pub(super) fn resume(&mut self, rings: &Rings) {
        self.earlier = rings.resume();
        self.number = self.earlier;
    }

    /// Appends a line.
    pub(super) fn push(&mut self, rings: &Rings, stamp: Stamp, topic: Topic, text: &str) {
        self.number += 1;
        rings.push(self.number, stamp, topic, text);
    }

    /// The number of the last line.
    pub(super) fn last(&self) -> u32 {
        self.number
    }

    /// The number of the last line of earlier runs.
    pub(super) fn earlier(&self) -> u32 {
        self.earlier
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
        // An ongoing flood gets one line per interval.
        (over.began, over.counted) = (now, 0);
        Some(due)
    }

    /// When the next tally is due.
    pub(super) fn next_due(&self) -> Option<Instant> {
        self.tallies.iter().map(|tally| tally.began + COUNTED_FOR).min()
    }
}
