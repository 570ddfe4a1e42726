//! One serial line seen from its client: waits for silence, sends a request, gathers the response.
//!
//! The end of an RTU response is known by its length and CRC where the request tells the length, else by the silence that
//! ends every frame (Modbus over Serial Line 2.5.1.1); an ASCII response ends itself. What is no response to the request
//! leaves the response timer running. The time that the request spends on the wire does not eat the response time.
//!
//! As soon as the first characters of a response tell how many there are at least, the line is left to itself until the last
//! of those is about to come, where the board wants that: a program that sleeps is woken for all of them together.

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};

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

/// An open line and what is expected on it.
pub(crate) struct SerialTransaction<'s, L> {
    line: Line<'s, L>,
    /// The units of the line.
    port_state: PortAt<'s>,
    tap: Tap<'s>,
    settings: &'s SerialSettings,
    /// What has come of an ASCII response, judged character by character; an RTU response is judged as a whole.
    decoder: Decoder,
    /// When the frame began that is being heard.
    begun: Instant,
    /// An ASCII frame had pauses in it that no copy of it could have: the next one is not begun.
    pauses: bool,
    /// The silence that ends what has begun.
    silence: Duration,
}

impl<'s, L: SerialLine> SerialTransaction<'s, L> {
    /// A line that was just opened; nothing is sent during the start delay.
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

    /// Waits until the line has been silent for the gap; what comes meanwhile is counted and dropped.
    pub(crate) async fn silence(&mut self) -> Result<(), LineLost> {
        loop {
            let silent_at = self.line.silent_at();
            match select(self.line.read(), until(silent_at)).await {
                Either::First(read) => {
                    read?;
                    // No frame is that long, and a line that babbles may never fall silent.
                    if self.line.heard().len() >= rtu::FRAME_BYTES_MAX {
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

    /// Discards what comes for so long after the line was opened: nobody knows what it answers.
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

    /// Watches the idle line until `until` is over, or something comes.
    pub(crate) async fn idle<T>(&mut self, until: impl Future<Output = T>) -> Result<(), LineLost> {
        match select(self.line.read(), until).await {
            Either::First(read) => read,
            Either::Second(_) => Ok(()),
        }
    }

    /// The turnaround delay behind a broadcast (Serial Line 2.4.1).
    pub(crate) fn turnaround(&self) -> Timer {
        Timer::at(self.line.active + self.settings.client.turnaround)
    }

    /// Sends the request `frame` to `unit` while it arrives.
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

    /// Waits for the response to what was just sent, and gives the time from the request's end to it.
    pub(crate) async fn receive(
        &mut self,
        incoming: &mut IncomingResponse<'_, '_>,
    ) -> Result<Result<Duration, Failure>, LineLost> {
        let sent = self.line.active;
        let deadline = sent + self.settings.client.timeout;
        // A frame that has begun in time is heard to its end, but a line that babbles is not heard for ever.
        let longest = self.line.settings.chars(self.settings.framing.chars_max());
        let end = deadline + longest + self.silence;
        // What was read with the request's echo, if anything was.
        let mut found =
            if self.line.heard().is_empty() { Found::Nothing } else { self.match_response(incoming) };
        let outcome = loop {
            match found {
                Found::Nothing => {}
                Found::Response => break Ok(()),
                Found::Corrupt(error) => break Err(Failure::Corrupt(error)),
                Found::Other => {
                    if !self.line.heard().is_empty() {
                        found = self.match_response(incoming);
                        continue;
                    }
                }
            }
            let has_begun = self.has_begun();
            // What seems to have begun before the request was over comes by no wire, but from a PTY: at once.
            if L::RESTS
                && has_begun
                && self.line.begun() >= sent
                && let Some(due) = self.due(incoming)
                && self.line.rest(due).await
            {
                // What has not been read is no silence.
                self.line.active = self.line.active.max(Instant::now());
            }
            let over = match has_begun {
                true => end.min(self.line.quiet_at(self.silence)),
                false => deadline,
            };
            found = match select(self.line.read(), until(over.min(incoming.due()))).await {
                Either::Second(()) if self.line.is_relayed() && Instant::now() < end => Found::Nothing,
                Either::First(read) => {
                    read?;
                    self.pauses |= self.decoder.in_frame() && self.line.pauses();
                    self.match_response(incoming)
                }
                Either::Second(()) if Instant::now() < over => self.match_response(incoming),
                Either::Second(()) if has_begun => self.match_at_silence(incoming),
                Either::Second(()) => break Err(Failure::Timeout),
            };
        };
        self.line.clear();
        if outcome.is_err() {
            // What came damaged may have met the end of the request. A good response has not: behind a PTY it may be early.
            self.line.active = self.line.active.max(sent);
        }
        Ok(outcome.map(|()| self.line.active.saturating_duration_since(sent)))
    }

    /// Sends to `unit` what the dispatcher has to send for `request`.
    pub(crate) fn send<'a, 'g>(
        &'a mut self,
        unit: u8,
        dispatcher: &'a Dispatcher<'g>,
        request: &'a Frame<'g>,
    ) -> impl Future<Output = Result<Result<(), Collision>, LineLost>> + use<'a, 's, 'g, L> {
        self.decoder.clear();
        // The future of an `async fn` would keep its arguments twice.
        async move {
            let mut frame = [0; FRAME_CHARS_MAX];
            let length = dispatcher.with_request(request, |request| {
                self.settings.framing.encode(unit, request, LINE_FEED, &mut frame).map_or(0, <[u8]>::len)
            });
            let frame = frame.get(..length).filter(|frame| !frame.is_empty()).ok_or(LineLost)?;
            let sent = self.line.send(frame).await;
            self.tap.sent(self.line.active, Event::Request, frame);
            if sent == Ok(Err(Collision)) {
                self.line.clear();
            }
            sent
        }
    }

    /// Notes a request that was sent while it arrived.
    pub(crate) fn note_forwarded(&self, unit: u8, request: &[u8], crc: Option<u16>) {
        let end = (crc, LINE_FEED);
        self.tap.forwarded(self.line.active, Event::Request, self.settings.framing, (unit, request), end);
    }

    /// Whether something has begun of which more is to come.
    fn has_begun(&self) -> bool {
        match self.settings.framing {
            Framing::Rtu => !self.line.heard().is_empty(),
            Framing::Ascii => self.decoder.in_frame(),
        }
    }
}
