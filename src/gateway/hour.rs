//! The errors of units in the last hour, for charts: samples of their counters every five minutes.
//!
//! The web interface's task takes the samples, so that requests cost nothing extra.

use core::cell::RefCell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_time::{Duration, Instant};
use heapless::Vec;

use super::port_state::PortAt;
use super::shared::Shared;
use super::unit_health::Unit;
use crate::settings::PortId;
use crate::stats::Event;

/// Time between two marks.
const SPAN: Duration = Duration::from_secs(300);
/// Times between marks in an hour.
pub(crate) const SPANS: usize = 12;
/// Nonzero counters of a sample; few units have errors. Counters that do not fit count from zero.
const COUNTS_MAX: usize = if cfg!(feature = "small") { 16 } else { 64 };

/// A counter of a unit.
struct Count {
    port: PortId,
    unit: u8,
    error: Event,
    count: u16,
}

/// The counters at a time.
struct Mark {
    at: Instant,
    counts: Vec<Count, COUNTS_MAX>,
}

impl Mark {
    fn count(&self, port: PortId, unit: u8, error: Event) -> u16 {
        let is_it = |count: &&Count| (count.port, count.unit, count.error) == (port, unit, error);
        self.counts.iter().find(is_it).map_or(0, |count| count.count)
    }
}

/// The marks of an hour, the oldest first.
pub(crate) struct Hour(Shared<Vec<Mark, SPANS>>);

impl Hour {
    pub(super) const fn new() -> Self {
        Self(Mutex::new(RefCell::new(Vec::new())))
    }

    /// When the next mark is due.
    pub(crate) fn due(&self) -> Instant {
        self.0.lock(|marks| marks.borrow().last().map_or(Instant::MIN, |mark| mark.at + SPAN))
    }

    /// Marks the counters of the units behind `ports` if that is due.
    pub(crate) fn mark<'g>(&self, now: Instant, ports: impl Iterator<Item = PortAt<'g>>) {
        if self.due() > now {
            return;
        }
        let mut mark = Mark { at: now, counts: Vec::new() };
        for port in ports {
            port.units(|units| {
                for unit in units.iter() {
                    for (error, count) in unit.errors() {
                        // See `COUNTS_MAX`.
                        let _ = mark.counts.push(Count { port: port.id, unit: unit.id, error, count });
                    }
                }
            });
        }
        self.0.lock(|marks| {
            let mut marks = marks.borrow_mut();
            if marks.is_full() {
                marks.remove(0);
            }
            // There is room now.
            let _ = marks.push(mark);
        });
    }

    /// How often `error` occurred at a unit, from one mark to the next and from the last one to now; the oldest first. What
    /// was counted before the counters were cleared is not in them.
    pub(crate) fn errors(&self, port: PortId, unit: &Unit, error: Event) -> [u16; SPANS] {
        let mut counts = [0; SPANS];
        self.0.lock(|marks| {
            let mut later = unit.error(error);
            let marks = marks.borrow();
            for (place, mark) in counts.iter_mut().rev().zip(marks.iter().rev()) {
                let earlier = mark.count(port, unit.id, error);
                *place = later.checked_sub(earlier).unwrap_or(later);
                later = earlier;
            }
        });
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gateway::Ports;

    #[test]
    fn errors_are_told_by_five_minutes_and_those_of_an_hour_ago_are_gone() {
        let (ports, hour, mut now) = (Ports::<1>::new(), Hour::new(), Instant::from_secs(1));
        let port = || PortAt { state: &ports.states[0], units: &ports.units, id: PortId(0) };
        let noise = |times| (0..times).for_each(|_| port().units(|units| units.error(7, Event::Noise)));
        let told = || {
            let unit = port().units(|units| units.iter().next().copied()).unwrap();
            hour.errors(PortId(0), &unit, Event::Noise)
        };
        hour.mark(now, [port()].into_iter());
        noise(3);
        assert_eq!(told(), [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3]);
        hour.mark(now + SPAN / 2, [port()].into_iter());
        assert_eq!(told()[11], 3, "too early");
        now += SPAN;
        hour.mark(now, [port()].into_iter());
        noise(1);
        assert_eq!(told(), [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3, 1]);
        for _ in 0..10 {
            now += SPAN;
            hour.mark(now, [port()].into_iter());
        }
        assert_eq!(told(), [3, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        now += SPAN;
        hour.mark(now, [port()].into_iter());
        assert_eq!(told(), [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        port().units(|units| units.clear_counters());
        noise(2);
        assert_eq!(told(), [1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2], "cleared");
    }
}
