//! The search for the response in what a line brings; what is found of it is passed on as it comes.

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
    /// Looks at what has come so far.
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
        match rtu::response(incoming.unit(), incoming.request(), self.line.heard()) {
            Received::Complete(pdu) => match self.judge(incoming.unit(), pdu, true, Event::Misfit) {
                Ok(()) => {
                    incoming.whole(self.line.heard(), pdu);
                    self.note(Event::Response);
                    Found::Response
                }
                Err(event) => {
                    let end = rtu::end_of(pdu, self.line.heard());
                    let found = self.other(incoming.unit(), event);
                    incoming.not_yet(self.line.heard(), true);
                    self.line.consume(end);
                    found
                }
            },
            Received::Partial => {
                incoming.not_yet(self.line.heard(), false);
                Found::Nothing
            }
        }
    }

    /// Looks through what was heard up to the first end of a frame.
    fn match_ascii(&mut self, incoming: &mut IncomingResponse<'_, '_>) -> Found {
        let (unit, request) = (incoming.unit(), incoming.request());
        for (before, &character) in self.line.heard().iter().enumerate() {
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
                    match self.judge(unit, response, true, Event::Misfit) {
                        Ok(()) => {
                            incoming.whole(self.decoder.bytes(), response);
                            self.note(Event::Response);
                            Found::Response
                        }
                        Err(event) => self.other(unit, event),
                    }
                }
                (Ok(()), [from, response @ .., _]) if *from != unit => self.foreign(unit, *from, response),
                (Ok(()), [_, response @ .., _]) if response == request => self.other(unit, Event::Echo),
                (Ok(()), [_, response @ .., _]) => self.misfit(unit, response),
                (Ok(()), _) => self.other(unit, Event::Misfit),
                (Err(AsciiError::Lrc { .. }), _) => self.damage(unit, request, Event::BadCheck),
                (Err(_), _) => self.damage(unit, request, Event::Short),
            };
            incoming.not_yet(&[], true);
            self.line.consume(before + 1);
            return found;
        }
        self.line.clear();
        self.pass_on(incoming);
        Found::Nothing
    }

    /// Looks at what has come when nothing more is to come of it.
    pub(super) fn match_at_silence(&mut self, incoming: &mut IncomingResponse<'_, '_>) -> Found {
        let (unit, request) = (incoming.unit(), incoming.request());
        let found = match self.settings.framing {
            Framing::Rtu => match rtu::response_at_silence(unit, request, self.line.heard()) {
                AtSilence::Complete(pdu) => match self.judge(unit, pdu, true, Event::Misfit) {
                    Ok(()) => {
                        incoming.whole(self.line.heard(), pdu);
                        self.note(Event::Response);
                        Found::Response
                    }
                    Err(event) => self.other(unit, event),
                },
                AtSilence::Corrupt => self.corrupt(Event::BadCheck),
                AtSilence::Short => self.corrupt(Event::Short),
                AtSilence::WrongUnit(from, response) => self.foreign(unit, from, response),
                AtSilence::Misfit(_, response) => self.misfit(unit, response),
                AtSilence::Noise => self.other(unit, Event::Noise),
            },
            Framing::Ascii => {
                self.decoder.clear();
                self.damage(unit, request, Event::Short)
            }
        };
        incoming.not_yet(self.line.heard(), true);
        self.line.clear();
        found
    }

    /// Whether the gateway's own request has come back, where no response could look like it.
    fn is_own(&self, incoming: &IncomingResponse<'_, '_>) -> bool {
        let request = incoming.request();
        let whole = self.line.heard().get(..request.len() + rtu::OVERHEAD_BYTES);
        // Mostly a look at the bytes tells that it has not, without a CRC.
        let like = whole.filter(|frame| frame.get(1..=request.len()) == Some(request));
        like.and_then(|frame| rtu::decode(frame).ok()) == Some((incoming.unit(), request))
            && pdu::fits(request, request).is_err()
    }

    /// Whether `response`, in a good frame of `unit`, is the one that is `awaited`; if not, it is a late one, or `other`.
    fn judge(&self, unit: u8, response: &[u8], awaited: bool, other: Event) -> Result<(), Event> {
        let judged = self.port_state.units(|units| units.heard(unit, response, awaited, Instant::now()));
        judged.map_err(|event| if event == Event::Late { event } else { other })
    }

    /// A good frame of another unit than the one that is awaited; what is counted is counted with that one if it is no late one.
    fn foreign(&self, awaited: u8, from: u8, response: &[u8]) -> Found {
        match self.judge(from, response, false, Event::WrongUnit) {
            Err(Event::Late) => self.other(from, Event::Late),
            _ => self.other(awaited, Event::WrongUnit),
        }
    }

    /// A good frame of the awaited `unit` that does not answer what it was asked.
    fn misfit(&self, unit: u8, response: &[u8]) -> Found {
        let judged = self.judge(unit, response, false, Event::Misfit);
        self.other(unit, judged.err().unwrap_or(Event::Misfit))
    }

    /// When a response that has begun will have all but the last one of the characters that it has at least. That one is waited
    /// for: a sleep until it is due would end a little later than it comes.
    pub(super) fn due(&self, incoming: &IncomingResponse<'_, '_>) -> Option<Instant> {
        let (Framing::Rtu, false, Some((&unit, so_far))) =
            (self.settings.framing, incoming.is_passed_on(), self.line.heard().split_first())
        else {
            return None;
        };
        let pdu_bytes = match pdu::response_end(incoming.request(), so_far) {
            _ if unit != incoming.unit() => return None,
            End::At(length) => length,
            // It may be an exception.
            End::Later => EXCEPTION_BYTES.max(so_far.len() + 1),
            End::Unknown => return None,
        };
        Some(self.line.begun() + self.line.settings.chars(pdu_bytes + rtu::OVERHEAD_BYTES - 1))
    }

    /// Passes on what has been heard of a frame, if it is time. What is read late must not be missing.
    fn pass_on(&self, incoming: &mut IncomingResponse<'_, '_>) {
        if !incoming.is_passed_on() {
            return;
        }
        let heard = match self.settings.framing {
            Framing::Rtu => self.line.heard(),
            Framing::Ascii if self.decoder.in_frame() => self.decoder.bytes(),
            Framing::Ascii => return,
        };
        let lane = Lane { framing: self.settings.framing, line: *self.line.settings };
        incoming.hear(heard, self.begun + self.line.jitter, &lane);
    }

    /// What an ASCII frame was that did not come well, for this `reason`: the response if it begins as that does.
    fn damage(&self, unit: u8, request: &[u8], reason: Event) -> Found {
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
