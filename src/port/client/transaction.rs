//! Transactions on a serial line, client side: wait for silence, send a request, receive the response.
//!
//! An RTU response ends by length and CRC where the request determines the length, otherwise by the silence that ends every frame
//! (Modbus over Serial Line 2.5.1.1); an ASCII response is delimited. Frames that do not match the request leave the response
//! timer running. The time the request takes on the wire does not count as response time.
//!
//! As soon as the first characters give a minimum length, those of it that are missing are needed together. A board that counts
//! characters wakes the program with the last of them, also with that of the shortest response; where a board prefers it, reading
//! pauses until the last one is due.

use core::mem;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use heapless::Vec;

use crate::capture::Tap;
use crate::frame::Frame;
use crate::gateway::direct_request::Failure;
use crate::gateway::{Gateway, PortAt};
use crate::hal::SerialLine;
use crate::modbus::ascii::{Decoder, LINE_FEED};
use crate::modbus::rtu;
use crate::port::client::dispatcher::Dispatcher;
use crate::port::cut_through::egress::{Form, Forwarded, forward};
use crate::port::cut_through::response::IncomingResponse;
use crate::port::line::framing::FRAME_CHARS_MAX;
use crate::port::line::{Collision, Line, LineLost};
use crate::port::timer::until;
use crate::settings::{Framing, SerialSettings};
use crate::stats::Event;

mod found;
mod matching;
mod unsolicited;

use found::Found;

/// An open line and the state of the current transaction.
pub(crate) struct SerialTransaction<'s, L> {
    line: Line<'s, L>,
    /// The port, including the line's units.
    port_state: PortAt<'s>,
    tap: Tap<'s>,
    settings: &'s SerialSettings,
    /// Decodes an ASCII response character by character; an RTU response is judged as a whole.
    decoder: Decoder,
    /// When the frame being received began.
    begun: Instant,
    /// An ASCII frame had pauses that cannot be reproduced: the next one is not forwarded while it arrives.
    pauses: bool,
    /// The silence that ends a frame.
    silence: Duration,
}

impl<'s, L: SerialLine> SerialTransaction<'s, L> {
    /// A newly opened line; nothing is sent during the start delay.
    pub(crate) fn new(
        mut line: Line<'s, L>,
        dispatcher: &'s Dispatcher<'_>,
        settings: &'s SerialSettings,
    ) -> Self {
        line.active += settings.client.start_delay;
        let silence = settings.framing.silence(line.settings) + line.jitter;
        let port_state = *dispatcher.port_state();
        let tap = Tap {
            capture: dispatcher.gateway().capture(),
            port: dispatcher.id(),
            kind: settings.framing.into(),
        };
        let (begun, decoder) = (line.active, Decoder::default());
        Self { line, port_state, tap, settings, decoder, begun, pauses: false, silence }
    }

    /// Waits until the line has been silent for the gap; bytes received meanwhile are counted and dropped.
    pub(crate) async fn silence(&mut self) -> Result<(), LineLost> {
        loop {
            let silent_at = self.line.silent_at();
            match select(self.line.read(), until(silent_at)).await {
                Either::First(read) => {
                    read?;
                    // Longer than any frame: a babbling line may never fall silent.
                    if self.line.received().len() >= rtu::FRAME_BYTES_MAX {
                        self.judge_unsolicited();
                    }
                }
                Either::Second(()) => {
                    self.judge_unsolicited();
                    return Ok(());
                }
            }
        }
    }

    /// Discards everything received within `window` after opening: it cannot be matched to a request.
    pub(crate) async fn discard(&mut self, window: Duration) -> Result<(), LineLost> {
        let end = self.line.active + window;
        while let Either::First(read) = select(self.line.read(), until(end)).await {
            read?;
            self.line.stats.count(Event::Noise);
            self.note(Event::Noise);
            self.line.clear();
        }
        Ok(())
    }

    /// Watches the idle line until `until` completes or something arrives.
    pub(crate) async fn idle<T>(&mut self, until: impl Future<Output = T>) -> Result<(), LineLost> {
        match select(self.line.read(), until).await {
            Either::First(read) => read,
            Either::Second(_) => Ok(()),
        }
    }

    /// The turnaround delay after a broadcast (Serial Line 2.4.1).
    pub(crate) fn turnaround(&self) -> Timer {
        Timer::at(self.line.active + self.settings.client.turnaround)
    }

    /// Forwards the request in `frame` to `unit` while it arrives.
    pub(crate) fn forward(
        &mut self,
        gateway: &Gateway<'_>,
        frame: &Frame<'_>,
        unit: u8,
        may_wait: bool,
    ) -> impl Future<Output = Result<Forwarded, LineLost>> {
        self.decoder.clear();
        let (framing, envelope) = (self.settings.framing, frame.envelope());
        let (source, from) = (Some(envelope.origin.port), envelope.unit);
        let form = Form { framing, may_wait, delimiter: LINE_FEED, source, from, to: unit };
        forward(gateway, &mut self.line, frame, form)
    }

    /// Waits for the response to the request just sent; returns the time from the end of the request to the response.
    pub(crate) async fn receive(
        &mut self,
        incoming: &mut IncomingResponse<'_, '_>,
    ) -> Result<Result<Duration, Failure>, LineLost> {
        let sent = self.line.active;
        let deadline = sent + self.settings.client.timeout;
        // A frame that began in time is received to its end, but a babbling line is not read forever.
        let longest = self.line.settings.chars(self.settings.framing.chars_max());
        let end = deadline + longest + self.silence;
        // Characters that come too late to be gathered are read as they are.
        let mut is_late = false;
        // The echo of the request may have been read together with the start of the response.
        let mut found =
            if self.line.received().is_empty() { Found::Nothing } else { self.match_response(incoming) };
        let outcome = loop {
            match found {
                Found::Response => break Ok(()),
                Found::Corrupt(error) => break Err(Failure::Corrupt(error)),
                Found::Other if !self.line.received().is_empty() => {
                    found = self.match_response(incoming);
                    continue;
                }
                Found::Nothing | Found::Other => {}
            }
            let has_begun = self.has_begun();
            let missing = if mem::take(&mut is_late) { None } else { self.missing(incoming) };
            let gathered = missing.filter(|count| self.line.gather(*count));
            // A start before the end of the request is impossible on a wire, but not on a PTY, which delivers at once.
            if L::RESTS
                && gathered.is_none()
                && let Some(count) = missing.filter(|_| has_begun && self.line.begun() >= sent)
                && self.line.rest_before(count).await
            {
                // Unread characters do not count as silence.
                self.line.active = self.line.active.max(Instant::now());
            }
            let over = if has_begun { end.min(self.quiet_at(gathered)) } else { deadline };
            found = match select(self.line.read(), until(over.min(incoming.due()))).await {
                Either::First(read) => {
                    read?;
                    self.pauses |= self.decoder.in_frame() && self.line.pauses();
                    self.match_response(incoming)
                }
                Either::Second(()) if gathered.is_some() => {
                    is_late = self.line.gather(1);
                    Found::Nothing
                }
                Either::Second(()) if self.line.is_relayed() && Instant::now() < end => Found::Nothing,
                Either::Second(()) if Instant::now() < over => self.match_response(incoming),
                Either::Second(()) if has_begun => self.match_at_silence(incoming),
                Either::Second(()) => break Err(Failure::Timeout),
            };
        };
        self.line.clear();
        if outcome.is_err() {
            // Corrupt bytes may overlap the end of the request. A good response cannot, though on a PTY it may seem early.
            self.line.active = self.line.active.max(sent);
        }
        Ok(outcome.map(|()| self.line.active.saturating_duration_since(sent)))
    }

    /// When silence may have ended the frame; so many characters are `gathered` first.
    fn quiet_at(&self, gathered: Option<usize>) -> Instant {
        self.line.quiet_at(self.silence + self.line.settings.chars(gathered.unwrap_or(0)))
    }

    /// Sends the PDU for `request` to `unit`.
    pub(crate) fn send<'a, 'g>(
        &'a mut self,
        unit: u8,
        dispatcher: &'a Dispatcher<'g>,
        request: &'a Frame<'g>,
    ) -> impl Future<Output = Result<Result<(), Collision>, LineLost>> + use<'a, 's, 'g, L> {
        self.decoder.clear();
        // The future of an `async fn` would store its arguments twice.
        async move {
            let mut frame = Vec::<u8, FRAME_CHARS_MAX>::new();
            let is_encoded = dispatcher.with_request(request, |request| {
                let framing = self.settings.framing;
                // No longer than it must be: most requests are short.
                frame.resize_default(framing.chars_of(request.len())).is_ok()
                    && framing.encode(unit, request, LINE_FEED, &mut frame).is_ok()
            });
            if !is_encoded {
                return Err(LineLost);
            }
            let sent = self.line.send(&frame).await;
            self.tap.sent(self.line.active, Event::Request, &frame);
            if sent == Ok(Err(Collision)) {
                self.line.clear();
            }
            sent
        }
    }

    /// Passes a request that was forwarded while it arrived to the capture.
    pub(crate) fn note_forwarded(&self, unit: u8, request: &[u8], crc: Option<u16>) {
        let end = (crc, LINE_FEED);
        self.tap.forwarded(self.line.active, Event::Request, self.settings.framing, (unit, request), end);
    }

    /// Whether a frame has begun and is incomplete.
    fn has_begun(&self) -> bool {
        match self.settings.framing {
            Framing::Rtu => !self.line.received().is_empty(),
            Framing::Ascii => self.decoder.in_frame(),
        }
    }
}
