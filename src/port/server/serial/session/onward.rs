//! Requests that a serial server hands on while they arrive.
//!
//! As soon as the rules and the other line's speed allow, a frame goes to the router that is filled character by character.
//! The ear judges the request all the same when it is whole: only what it takes for a good one is finished. Whatever else
//! becomes of it breaks the frame, and the request goes the way of all others.

use core::mem;

use embassy_time::Instant;

use super::{Session, Sniffer};
use crate::frame::Envelope;
use crate::hal::SerialLine;
use crate::modbus::pdu::{self, End};
use crate::port::cut_through::ingress::{Ingress, Passing, is_whole};
use crate::port::server::serial::server::Server;
use crate::routing::Onward;
use crate::settings::Lane;
use crate::stats::Event;

impl<'g, L: SerialLine> Session<'_, 'g, L> {
    /// A frame begins with what has been heard.
    pub(super) fn begin(&mut self) {
        self.begun = self.line.begun();
        let in_step = match &self.sniffer {
            Sniffer::Rtu(sniffer) => !sniffer.needs_silence(),
            Sniffer::Ascii(_) => !mem::take(&mut self.pauses),
        };
        // What follows at once is an echo, a collision, or stray bits.
        let is_separated = self.line.pause() >= self.line.settings.gap() / 2;
        self.passing = if in_step && is_separated { Passing::Open } else { Passing::Whole };
    }

    /// Notes a pause in an ASCII frame before what has just been read.
    pub(super) fn watch_pauses(&mut self) {
        let is_inside = matches!(&self.sniffer, Sniffer::Ascii(sniffer) if sniffer.in_frame());
        self.pauses |= is_inside && self.line.pauses();
    }

    /// Passes on what has been heard by now, if it is time. Says whether that is a whole RTU request which was passed on.
    pub(super) fn pass_on(&mut self) -> bool {
        let received = match &self.sniffer {
            Sniffer::Rtu(_) => self.line.received(),
            Sniffer::Ascii(sniffer) => sniffer.received(),
        };
        let Some((&unit, so_far)) = received.split_first() else { return false };
        let end = pdu::request_end(so_far);
        if let Passing::Open | Passing::At(_) = self.passing {
            self.passing = self.plan(unit, so_far, end);
        }
        if self.passing.is_due() {
            self.passing = self.server.start_ingress(unit, self.begun).map_or(Passing::Whole, Passing::Begun);
        }
        let Passing::Begun(arriving) = &mut self.passing else { return false };
        if !arriving.take(received, end) {
            self.passing = Passing::Whole;
            // The next such function is not begun.
            self.wary = true;
        }
        matches!(self.sniffer, Sniffer::Rtu(_)) && is_whole(so_far, end)
    }

    fn plan(&self, unit: u8, so_far: &[u8], end: End) -> Passing<'g> {
        if self.wary && so_far.is_empty() {
            return Passing::Open;
        }
        match self.server.onward(unit, so_far) {
            Onward::Whole => Passing::Whole,
            Onward::Later => Passing::Open,
            // What is read late must not be missing.
            Onward::To(output) => {
                Passing::plan(self.begun + self.line.jitter, &Lane::of(self.server.settings), &output, end)
            }
        }
    }
}

impl<'g> Server<'_, 'g> {
    /// A request has been judged good: whether the frame that was handed on is all that is needed.
    pub(super) fn finish(&self, passing: &mut Passing<'g>, request: &[u8], received: Instant) -> bool {
        let Passing::Begun(arriving) = mem::replace(passing, Passing::Whole) else { return false };
        if pdu::check_request(request).is_err() {
            return false;
        }
        let frame = arriving.frame();
        let deadline = received + self.settings.server.answer_within;
        frame.address(Envelope { received, deadline, ..frame.envelope() });
        let finished = arriving.finish(request);
        if finished {
            self.port_state.stats.count(Event::Request);
        }
        finished
    }

    /// Sends the frame of a request that began at `begun` to the router, before it is there.
    fn start_ingress(&self, unit: u8, begun: Instant) -> Option<Ingress<'g>> {
        let (writer, frame) = self.take_frame()?;
        let envelope = self.envelope(unit, begun);
        let framing = self.settings.framing;
        let longest = self.settings.line.chars(framing.chars_max());
        frame.address(Envelope { deadline: envelope.deadline + longest, cut: true, ..envelope });
        self.gateway.inbox.send(frame);
        Some(Ingress::new(writer, framing))
    }
}
