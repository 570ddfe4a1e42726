//! What a line brings that nobody asked for, or that is not what was asked for: counted by what it is, and with which unit.

use embassy_time::Instant;

use super::SerialTransaction;
use super::found::Found;
use crate::hal::SerialLine;
use crate::modbus::rtu;
use crate::settings::Framing;
use crate::stats::Event;

impl<L: SerialLine> SerialTransaction<'_, L> {
    /// Counts something heard that is not the response of `unit`, which was awaited.
    pub(super) fn other(&self, unit: u8, event: Event) -> Found {
        self.line.stats.count(event);
        // What the receiver says of noise is nearer to its cause.
        let error = if event == Event::Noise { self.line.flaw().unwrap_or(event) } else { event };
        self.port_state.units(|units| units.error(unit, error));
        self.note(error);
        Found::Other
    }

    /// The response came damaged, for this `reason` unless the receiver knows better.
    pub(super) fn corrupt(&self, reason: Event) -> Found {
        let error = self.line.flaw().unwrap_or(reason);
        self.note(error);
        Found::Corrupt(error)
    }

    /// Records what has been heard, and what it is.
    pub(super) fn note(&self, verdict: Event) {
        self.tap.heard(self.line.active, verdict, self.line.heard());
    }

    /// Counts what was heard while no response was awaited, and drops it: the late response of a unit that timed out, or noise.
    pub(super) fn judge_unsolicited(&mut self) {
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
                let judged = self.port_state.units(|units| units.heard(unit, pdu, false, Instant::now()));
                let event = judged.err().unwrap_or(Event::Unsolicited);
                self.port_state.disturbed(unit, event);
                last = Some(event);
            }
        }
        last
    }

    /// Judges and counts a good frame of `unit` that is not awaited.
    pub(super) fn unawaited(&self, unit: u8, response: &[u8]) -> Event {
        let judged = self.port_state.units(|units| units.heard(unit, response, false, Instant::now()));
        let event = judged.err().unwrap_or(Event::Unsolicited);
        self.port_state.disturbed(unit, event);
        event
    }
}
