//! Matches the bytes received from a line to the request, and forwards the response while it arrives.

use core::mem;

use embassy_time::Instant;

use super::SerialTransaction;
use super::found::Found;
use crate::hal::SerialLine;
use crate::modbus::ascii::{AsciiError, COLON};
use crate::modbus::pdu::{self, EXCEPTION_BIT, End};
use crate::modbus::rtu::{self, AtSilence, Received};
use crate::port::cut_through::response::IncomingResponse;
use crate::settings::{Framing, Lane};
use crate::stats::Event;

/// Bytes of an exception's PDU.
const EXCEPTION_BYTES: usize = 2;

impl<L: SerialLine> SerialTransaction<'_, L> {
    /// Classifies the bytes received so far.
    pub(super) fn match_response(&mut self, incoming: &mut IncomingResponse<'_, '_>) -> Found {
        if self.settings.framing == Framing::Ascii {
            return self.match_ascii(incoming);
        }
        self.begun = self.line.begun();
        if self.is_own(incoming) {
            let found = self.other(incoming.unit(), Event::Echo);
            self.line.consume(incoming.request().len() + rtu::OVERHEAD_BYTES);
            return found;
        }
        self.pass_on(incoming);
        match rtu::response(incoming.unit(), incoming.request(), self.line.received()) {
            Received::Complete(pdu) => {
                let found = self.matched(incoming, self.line.received(), pdu);
                if !matches!(found, Found::Response) {
                    let end = rtu::end_of(pdu, self.line.received());
                    incoming.not_yet(self.line.received(), true);
                    self.line.consume(end);
                }
                found
            }
            Received::Partial => {
                incoming.not_yet(self.line.received(), false);
                Found::Nothing
            }
        }
    }

    /// Classifies the characters received, up to the first end of a frame.
    fn match_ascii(&mut self, incoming: &mut IncomingResponse<'_, '_>) -> Found {
        let (unit, request) = (incoming.unit(), incoming.request());
        for (before, &character) in self.line.received().iter().enumerate() {
            if character == COLON {
                self.begun = self.line.begun() + self.line.settings.chars(before);
                incoming.begin(!mem::take(&mut self.pauses));
            }
            let Some(judged) = self.decoder.push(character).map(|judged| judged.map(|_| ())) else {
                continue;
            };
            let found = match (judged, self.decoder.bytes()) {
                (Ok(()), [from, response @ .., _])
                    if *from == unit && pdu::fits(request, response).is_ok() =>
                {
                    self.matched(incoming, self.decoder.bytes(), response)
                }
                (Ok(()), [from, response @ .., _]) if *from != unit => self.wrong_unit(unit, *from, response),
                (Ok(()), [_, response @ .., _]) if response == request => self.other(unit, Event::Echo),
                (Ok(()), [_, response @ .., _]) => self.misfit(unit, response),
                (Ok(()), _) => self.other(unit, Event::Misfit),
                (Err(AsciiError::Lrc { .. }), _) => self.corrupt_ascii(unit, request, Event::BadCheck),
                (Err(_), _) => self.corrupt_ascii(unit, request, Event::Short),
            };
            incoming.not_yet(&[], true);
            self.line.consume(before + 1);
            return found;
        }
        self.line.clear();
        self.pass_on(incoming);
        Found::Nothing
    }

    /// Classifies the bytes received once silence has ended a frame.
    pub(super) fn match_at_silence(&mut self, incoming: &mut IncomingResponse<'_, '_>) -> Found {
        let (unit, request) = (incoming.unit(), incoming.request());
        let found = match self.settings.framing {
            Framing::Rtu => match rtu::response_at_silence(unit, request, self.line.received()) {
                AtSilence::Complete(pdu) => self.matched(incoming, self.line.received(), pdu),
                AtSilence::Corrupt => self.corrupt(Event::BadCheck),
                AtSilence::Short => self.corrupt(Event::Short),
                AtSilence::WrongUnit(from, response) => self.wrong_unit(unit, from, response),
                AtSilence::Misfit(_, response) => self.misfit(unit, response),
                AtSilence::Noise => self.other(unit, Event::Noise),
            },
            Framing::Ascii => {
                self.decoder.clear();
                self.corrupt_ascii(unit, request, Event::Short)
            }
        };
        incoming.not_yet(self.line.received(), true);
        self.line.clear();
        found
    }

    /// Whether the bytes begin with the echo of the gateway's own request, where a response cannot look the same.
    fn is_own(&self, incoming: &IncomingResponse<'_, '_>) -> bool {
        let request = incoming.request();
        let whole = self.line.received().get(..request.len() + rtu::OVERHEAD_BYTES);
        // Comparing the bytes first usually saves the CRC.
        let like = whole.filter(|frame| frame.get(1..=request.len()) == Some(request));
        like.and_then(|frame| rtu::decode(frame).ok()) == Some((incoming.unit(), request))
            && pdu::fits(request, request).is_err()
    }

    /// Handles `response`, in the valid `frame` from the unit that was asked, which matches the request.
    fn matched(&self, incoming: &mut IncomingResponse<'_, '_>, frame: &[u8], response: &[u8]) -> Found {
        match self.judge(incoming.unit(), response, true, Event::Misfit) {
            Ok(()) => {
                incoming.whole(frame, response);
                self.note(Event::Response);
                Found::Response
            }
            Err(event) => self.other(incoming.unit(), event),
        }
    }

    /// Accepts `response`, in a valid frame from `unit`, if it is the `expected` one; otherwise the event is `Late`, or `other`.
    fn judge(&self, unit: u8, response: &[u8], expected: bool, other: Event) -> Result<(), Event> {
        let judged =
            self.port_state.units(|units| units.match_response(unit, response, expected, Instant::now()));
        judged.map_err(|event| if event == Event::Late { event } else { other })
    }

    /// Handles a valid frame from a unit other than `expected`. A late response is counted for its own unit, anything else for the
    /// expected one.
    fn wrong_unit(&self, expected: u8, from: u8, response: &[u8]) -> Found {
        match self.judge(from, response, false, Event::WrongUnit) {
            Err(Event::Late) => self.other(from, Event::Late),
            _ => self.other(expected, Event::WrongUnit),
        }
    }

    /// Handles a valid frame from `unit` that does not match the request.
    fn misfit(&self, unit: u8, response: &[u8]) -> Found {
        let judged = self.judge(unit, response, false, Event::Misfit);
        self.other(unit, judged.err().unwrap_or(Event::Misfit))
    }

    /// Characters that are missing of the shortest possible response, if none of them is needed before the last.
    pub(super) fn missing(&self, incoming: &IncomingResponse<'_, '_>) -> Option<usize> {
        if self.settings.framing != Framing::Rtu || incoming.is_passed_on() {
            return None;
        }
        let received = self.line.received();
        let pdu_bytes = match received.split_first() {
            None => EXCEPTION_BYTES,
            Some((&unit, _)) if unit != incoming.unit() => return None,
            Some((_, so_far)) => match pdu::response_end(incoming.request(), so_far) {
                End::At(length) => length,
                // It may still be an exception.
                End::Later => EXCEPTION_BYTES.max(so_far.len() + 1),
                End::Unknown => return None,
            },
        };
        (pdu_bytes + rtu::OVERHEAD_BYTES).checked_sub(received.len()).filter(|count| *count > 0)
    }

    /// Forwards what has been received of a frame, if cut-through is on. Read latency counts as jitter, so that the sender never
    /// underruns.
    fn pass_on(&self, incoming: &mut IncomingResponse<'_, '_>) {
        if !incoming.is_passed_on() {
            return;
        }
        let received = match self.settings.framing {
            Framing::Rtu => self.line.received(),
            Framing::Ascii if self.decoder.in_frame() => self.decoder.bytes(),
            Framing::Ascii => return,
        };
        let lane = Lane { framing: self.settings.framing, line: *self.line.settings };
        incoming.feed(received, self.begun + self.line.jitter, &lane);
    }

    /// Classifies a bad ASCII frame: if it begins like the response, as corrupt for this `reason`; otherwise as noise.
    fn corrupt_ascii(&self, unit: u8, request: &[u8], reason: Event) -> Found {
        match (self.decoder.bytes(), request) {
            ([from, answered, ..], [function, ..])
                if *from == unit && answered & !EXCEPTION_BIT == *function =>
            {
                self.corrupt(reason)
            }
            _ => self.other(unit, Event::Noise),
        }
    }
}
