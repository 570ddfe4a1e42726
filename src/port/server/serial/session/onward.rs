//! Cut-through of requests at a serial server.
//!
//! As soon as the rules and the speed of the other line allow, a frame goes to the router and is filled character by character. The
//! sniffer still classifies the complete request: only one that it accepts is finished. In all other cases the frame is marked
//! broken, and the request is handled as usual.

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
    /// Handles the start of a frame.
    pub(super) fn begin(&mut self) {
        self.begun = self.line.begun();
        let in_step = match &self.sniffer {
            Sniffer::Rtu(sniffer) => !sniffer.needs_silence(),
            Sniffer::Ascii(_) => !mem::take(&mut self.pauses),
        };
        // Bytes without a preceding pause are an echo, a collision, or stray bits.
        let is_separated = self.line.pause() >= self.line.settings.gap() / 2;
        self.passing = if in_step && is_separated { Passing::Open } else { Passing::Whole };
    }

    /// Records a pause in an ASCII frame before what has just been read.
    pub(super) fn watch_pauses(&mut self) {
        let is_inside = matches!(&self.sniffer, Sniffer::Ascii(sniffer) if sniffer.in_frame());
        self.pauses |= is_inside && self.line.pauses();
    }

    /// Forwards what has been received, if due. Returns whether that was a complete RTU request.
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
            // The next such function is not cut through.
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
            // Read latency counts as jitter, so that the sender never underruns.
            Onward::To(output) => {
                Passing::plan(self.begun + self.line.jitter, &Lane::of(self.server.settings), &output, end)
            }
        }
    }
}

impl<'g> Server<'_, 'g> {
    /// Finishes a request that proved valid; returns whether the frame already forwarded is sufficient.
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

    /// Sends the frame of a request that began at `begun` to the router, to be filled while it arrives.
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
