//! Unsolicited or mismatched frames: counted by kind and by unit.

use embassy_time::Instant;

use super::SerialTransaction;
use super::found::Found;
use crate::hal::SerialLine;
use crate::modbus::rtu;
use crate::settings::Framing;
use crate::stats::Event;

impl<L: SerialLine> SerialTransaction<'_, L> {
    /// Counts something received instead of the response from `unit`.
    pub(super) fn other(&self, unit: u8, event: Event) -> Found {
        self.line.stats.count(event);
        // The receiver's own error is closer to the cause than noise.
        let error = if event == Event::Noise { self.line.flaw().unwrap_or(event) } else { event };
        self.port_state.units(|units| units.error(unit, error));
        self.note(error);
        Found::Other
    }

    /// Classifies the response as corrupt, for the receiver's reason if it has one, otherwise for this `reason`.
    pub(super) fn corrupt(&self, reason: Event) -> Found {
        let error = self.line.flaw().unwrap_or(reason);
        self.note(error);
        Found::Corrupt(error)
    }

    /// Passes what has been received to the capture, with the verdict.
    pub(super) fn note(&self, verdict: Event) {
        self.tap.received(self.line.active, verdict, self.line.received());
    }

    /// Counts and drops what was received while no response was expected: a late response, or noise.
    pub(super) fn judge_unsolicited(&mut self) {
        if self.line.received().is_empty() {
            return;
        }
        let late = match self.settings.framing {
            Framing::Rtu => {
                rtu::decode(self.line.received()).ok().map(|(unit, pdu)| self.unsolicited(unit, pdu))
            }
            Framing::Ascii => self.unsolicited_ascii(),
        };
        if late.is_none() {
            self.line.stats.count(Event::Noise);
        }
        self.note(late.unwrap_or(Event::Noise));
        self.line.clear();
    }

    /// Classifies each valid ASCII frame received; returns the event of the last one.
    fn unsolicited_ascii(&mut self) -> Option<Event> {
        self.decoder.clear();
        let mut last = None;
        for at in 0..self.line.received().len() {
            let Some(&character) = self.line.received().get(at) else { break };
            if let Some(Ok((unit, pdu))) = self.decoder.push(character) {
                let judged =
                    self.port_state.units(|units| units.match_response(unit, pdu, false, Instant::now()));
                let event = judged.err().unwrap_or(Event::Unsolicited);
                self.port_state.disturbed(unit, event);
                last = Some(event);
            }
        }
        last
    }

    /// Classifies and counts a valid unsolicited frame from `unit`.
    pub(super) fn unsolicited(&self, unit: u8, response: &[u8]) -> Event {
        let judged =
            self.port_state.units(|units| units.match_response(unit, response, false, Instant::now()));
        let event = judged.err().unwrap_or(Event::Unsolicited);
        self.port_state.disturbed(unit, event);
        event
    }
}
