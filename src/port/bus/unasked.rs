//! What a line brings that nobody asked for, or that is not what was asked for: counted by what it is, and with which unit.

use embassy_time::Instant;

use super::Bus;
use super::look::Found;
use crate::config::Framing;
use crate::hal::SerialLine;
use crate::modbus::rtu;
use crate::stats::Event;

impl<L: SerialLine> Bus<'_, L> {
    /// Counts something heard that is not the response of `unit`, which was awaited.
    pub(super) fn other(&self, unit: u8, event: Event) -> Found {
        self.line.stats.count(event);
        // What the receiver says of noise is nearer to its cause.
        let trouble = if event == Event::Noise { self.line.flaw().unwrap_or(event) } else { event };
        self.place.units(|units| units.trouble(unit, trouble));
        self.note(trouble);
        Found::Other
    }

    /// The response came damaged, for this `reason` unless the receiver knows better.
    pub(super) fn damaged(&self, reason: Event) -> Found {
        let trouble = self.line.flaw().unwrap_or(reason);
        self.note(trouble);
        Found::Damaged(trouble)
    }

    /// Records what has been heard, and what it is.
    pub(super) fn note(&self, verdict: Event) {
        self.tap.heard(self.line.active, verdict, self.line.heard());
    }

    /// Counts what was heard while no response was awaited, and drops it: the late answer of a unit that timed out, or noise.
    pub(super) fn judge_unasked(&mut self) {
        if self.line.heard().is_empty() {
            return;
        }
        let from =
            self.sender().filter(|unit| self.place.units(|units| units.is_late(*unit, Instant::now())));
        match from {
            Some(unit) => self.place.disturbed(unit, Event::Late),
            None => self.line.stats.count(Event::Noise),
        }
        self.note(if from.is_some() { Event::Late } else { Event::Noise });
        self.line.clear();
    }

    /// The unit of the good frame that was heard, if it is one.
    fn sender(&mut self) -> Option<u8> {
        match self.settings.framing {
            Framing::Rtu => rtu::decode(self.line.heard()).ok().map(|(unit, _)| unit),
            Framing::Ascii => {
                self.decoder.clear();
                let frames = self.line.heard().iter().filter_map(|&character| {
                    self.decoder.push(character).and_then(Result::ok).map(|(unit, _)| unit)
                });
                frames.last()
            }
        }
    }
}
