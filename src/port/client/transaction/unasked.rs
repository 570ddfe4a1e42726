//! What a line brings that nobody asked for, or that is not what was asked for: counted by what it is, and with which unit.

use embassy_time::Instant;

use super::Bus;
use super::found::Found;
use crate::hal::SerialLine;
use crate::modbus::rtu;
use crate::settings::Framing;
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
        let late = match self.settings.framing {
            Framing::Rtu => rtu::decode(self.line.heard()).ok().map(|(unit, pdu)| self.unawaited(unit, pdu)),
            Framing::Ascii => self.unawaited_ascii(),
        };
        if late.is_none() {
            self.line.stats.count(Event::Noise);
        }
        self.note(late.unwrap_or(Event::Noise));
        self.line.clear();
    }

    /// Judges every good ASCII frame that was heard; what the last one is.
    fn unawaited_ascii(&mut self) -> Option<Event> {
        self.decoder.clear();
        let mut last = None;
        for at in 0..self.line.heard().len() {
            let Some(&character) = self.line.heard().get(at) else { break };
            if let Some(Ok((unit, pdu))) = self.decoder.push(character) {
                let judged = self.place.units(|units| units.heard(unit, pdu, false, Instant::now()));
                let event = judged.err().unwrap_or(Event::Unsolicited);
                self.place.disturbed(unit, event);
                last = Some(event);
            }
        }
        last
    }

    /// Judges and counts a good frame of `unit` that is not awaited.
    pub(super) fn unawaited(&self, unit: u8, response: &[u8]) -> Event {
        let judged = self.place.units(|units| units.heard(unit, response, false, Instant::now()));
        let event = judged.err().unwrap_or(Event::Unsolicited);
        self.place.disturbed(unit, event);
        event
    }
}
