//! One serial line seen from its client: waits for silence, sends a request, gathers the response.
//!
//! The end of an RTU response is known by its length and CRC where the request tells the length, else by the silence that
//! ends every frame (Modbus over Serial Line 2.5.1.1); an ASCII response ends itself. What is no answer to the request
//! leaves the response timer running. The time that the request spends on the wire does not eat the response time.
//!
//! As soon as the first characters of a response tell how many there are at least, the line is left to itself until the last
//! of those is about to come, where the board wants that: a program that sleeps is woken for all of them together.

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, TimeoutError, Timer, with_deadline};

use crate::config::{Framing, SerialClientSettings, SerialSettings};
use crate::frame::Frame;
use crate::hal::SerialLine;
use crate::modbus::ascii::{Decoder, LINE_FEED};
use crate::modbus::pdu::{self, EXCEPTION_BIT, End};
use crate::modbus::rtu::{self, AtSilence, Received};
use crate::port::copy::{Copied, copy};
use crate::port::framing::FRAME_CHARS_MAX;
use crate::port::line::{Collision, Line, LineLost};
use crate::port::reply::Reply;
use crate::stats::Event;

/// Bytes of an exception's PDU.
const EXCEPTION_BYTES: usize = 2;

/// Why there is no response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Failure {
    /// None came in time; it may still come.
    Timeout,
    /// It came damaged.
    Damaged,
    /// The request was damaged by somebody who sent at the same time.
    Collision,
}

/// An open line and what is expected on it.
pub(crate) struct Bus<'s, L> {
    line: Line<'s, L>,
    client: SerialClientSettings,
    framing: Framing,
    /// What has come of an ASCII response, judged character by character; an RTU response is judged as a whole.
    decoder: Decoder,
    /// The silence that ends what has begun.
    silence: Duration,
}

/// What a look at the line found.
enum Found {
    /// Nothing yet, or noise between frames.
    Nothing,
    /// The response.
    Response,
    /// The response, but damaged.
    Damaged,
    /// Something else.
    Other(Event),
}

impl<'s, L: SerialLine> Bus<'s, L> {
    /// A line that was just opened; nothing is sent during the start delay.
    pub(crate) fn new(mut line: Line<'s, L>, settings: &SerialSettings) -> Self {
        line.active += settings.client.start_delay;
        let silence = settings.framing.silence(&line.settings) + line.jitter;
        let SerialSettings { client, framing, .. } = *settings;
        Self { line, client, framing, decoder: Decoder::default(), silence }
    }

    /// Waits until the line has been silent for the gap; what comes meanwhile is dropped.
    pub(crate) async fn silence(&mut self) -> Result<(), LineLost> {
        loop {
            self.line.clear();
            match with_deadline(self.line.silent_at(), self.line.read()).await {
                Ok(read) => {
                    read?;
                    self.line.stats.count(Event::Noise);
                }
                Err(TimeoutError) => return Ok(()),
            }
        }
    }

    /// Watches the idle line until `until` is over; what comes meanwhile is dropped.
    pub(crate) async fn idle<T>(&mut self, until: impl Future<Output = T>) -> Result<(), LineLost> {
        self.line.clear();
        match select(self.line.read(), until).await {
            Either::First(read) => {
                self.line.stats.count(Event::Noise);
                read
            }
            Either::Second(_) => Ok(()),
        }
    }

    /// Sends `request` to every unit and waits out the turnaround delay (Serial Line 2.4.1).
    pub(crate) async fn broadcast(&mut self, request: &[u8]) -> Result<(), LineLost> {
        // Nobody answers, so nobody can be asked again: a collision is counted, and that is all.
        let _ = self.send(0, request).await?;
        Timer::at(self.line.active + self.client.turnaround).await;
        Ok(())
    }

    /// Sends the order `frame` to `unit` while it arrives.
    pub(crate) async fn copy(&mut self, frame: &Frame<'_>, unit: u8) -> Result<Copied, LineLost> {
        self.decoder.clear();
        self.line.stats.count(Event::Request);
        copy(&mut self.line, frame, (frame.envelope().unit, unit)).await
    }

    /// Waits for the response to what was just sent, and gives the time from the request's end to it.
    pub(crate) async fn receive(
        &mut self,
        reply: &mut Reply<'_, '_>,
    ) -> Result<Result<Duration, Failure>, LineLost> {
        let sent = self.line.active;
        let outcome = self.response(reply, sent + self.client.timeout).await?;
        Ok(outcome.map(|()| self.line.active.saturating_duration_since(sent)))
    }

    /// Sends `request` to `unit`.
    pub(crate) async fn send(&mut self, unit: u8, request: &[u8]) -> Result<Result<(), Collision>, LineLost> {
        self.decoder.clear();
        let mut frame = [0; FRAME_CHARS_MAX];
        let frame = self.framing.encode(unit, request, LINE_FEED, &mut frame).map_err(|_| LineLost)?;
        let sent = self.line.send(frame).await;
        self.line.stats.count(Event::Request);
        sent
    }

    async fn response(
        &mut self,
        reply: &mut Reply<'_, '_>,
        deadline: Instant,
    ) -> Result<Result<(), Failure>, LineLost> {
        // A frame that has begun in time is heard to its end, but a line that babbles is not heard for ever.
        let longest = self.line.settings.chars(self.framing.chars_max());
        let end = deadline + longest + self.silence;
        let sent = self.line.active;
        let mut begun = sent;
        // A read can be late, and make a beginning seem late, but not early: the earliest is the best to go by.
        let mut earliest = sent;
        // What was read with the request's echo.
        let mut found = self.look(reply);
        loop {
            match found {
                Found::Nothing => {}
                Found::Response => return Ok(Ok(())),
                Found::Damaged => return Ok(Err(Failure::Damaged)),
                Found::Other(event) => {
                    self.line.stats.count(event);
                    if !self.line.heard().is_empty() {
                        found = self.look(reply);
                        continue;
                    }
                }
            }
            let before = self.line.heard().len();
            let has_begun = self.has_begun();
            // What seems to have begun before the request was over comes by no wire, but from a PTY: at once.
            if has_begun
                && earliest >= sent
                && let Some(due) = self.due(reply, earliest)
            {
                self.line.rest(due).await;
            }
            let until = if has_begun { end.min(self.line.active + self.silence) } else { deadline };
            found = match with_deadline(until.min(reply.due()), self.line.read()).await {
                Ok(read) => {
                    read?;
                    if before == 0 {
                        begun = self.line.begun();
                        earliest = begun;
                    }
                    earliest = earliest.min(self.line.begun());
                    self.pass_on(reply, begun);
                    self.look(reply)
                }
                Err(TimeoutError) if Instant::now() < until => {
                    self.pass_on(reply, begun);
                    Found::Nothing
                }
                Err(TimeoutError) if has_begun => self.look_at_silence(reply),
                Err(TimeoutError) => return Ok(Err(Failure::Timeout)),
            };
        }
    }

    /// Passes on what has been heard since `begun`, if it is time. What is read late must not be missing.
    fn pass_on(&self, reply: &mut Reply<'_, '_>, begun: Instant) {
        reply.hear(self.line.heard(), begun + self.line.jitter, &self.line.settings);
    }

    /// When the response that `begun` will have all but the last one of the characters that it has at least. That one is waited
    /// for: a sleep until it is due would end a little later than it comes.
    fn due(&self, reply: &Reply<'_, '_>, begun: Instant) -> Option<Instant> {
        let (Framing::Rtu, false, Some((&unit, so_far))) =
            (self.framing, reply.is_passed_on(), self.line.heard().split_first())
        else {
            return None;
        };
        let pdu_bytes = match pdu::response_end(reply.request(), so_far) {
            _ if unit != reply.unit() => return None,
            End::At(length) => length,
            // It may be an exception.
            End::Later => EXCEPTION_BYTES.max(so_far.len() + 1),
            End::Unknown => return None,
        };
        Some(begun + self.line.settings.chars(pdu_bytes + rtu::OVERHEAD_BYTES - 1))
    }

    /// Whether something has begun of which more is to come.
    fn has_begun(&self) -> bool {
        match self.framing {
            Framing::Rtu => !self.line.heard().is_empty(),
            Framing::Ascii => self.decoder.in_frame(),
        }
    }

    /// Looks at what has come so far.
    fn look(&mut self, reply: &mut Reply<'_, '_>) -> Found {
        let (unit, request) = (reply.unit(), reply.request());
        match self.framing {
            Framing::Rtu => match rtu::response(unit, request, self.line.heard()) {
                Received::Complete(pdu) => {
                    reply.whole(self.line.heard(), pdu);
                    Found::Response
                }
                Received::Partial => {
                    reply.not_yet(self.line.heard(), false);
                    Found::Nothing
                }
            },
            Framing::Ascii => {
                let (found, count) = look_for_ascii(&mut self.decoder, self.line.heard(), reply);
                self.line.consume(count);
                found
            }
        }
    }

    /// Looks at what has come when nothing more is to come of it.
    fn look_at_silence(&mut self, reply: &mut Reply<'_, '_>) -> Found {
        let (unit, request) = (reply.unit(), reply.request());
        let found = match self.framing {
            Framing::Rtu => match rtu::response_at_silence(unit, request, self.line.heard()) {
                AtSilence::Complete(pdu) => {
                    reply.whole(self.line.heard(), pdu);
                    Found::Response
                }
                AtSilence::Damaged => Found::Damaged,
                AtSilence::WrongUnit(_) => Found::Other(Event::WrongUnit),
                AtSilence::Misfit(_) => Found::Other(Event::Misfit),
                AtSilence::Noise => Found::Other(Event::Noise),
            },
            Framing::Ascii => {
                self.decoder.clear();
                damage(&self.decoder, unit, request)
            }
        };
        reply.not_yet(self.line.heard(), true);
        self.line.clear();
        found
    }
}

/// Looks through `heard` up to the first end of a frame, and says how many characters that took.
fn look_for_ascii(decoder: &mut Decoder, heard: &[u8], reply: &mut Reply<'_, '_>) -> (Found, usize) {
    let (unit, request) = (reply.unit(), reply.request());
    for (before, &character) in heard.iter().enumerate() {
        let found = match decoder.push(character) {
            None => continue,
            Some(Ok((from, _))) if from != unit => Found::Other(Event::WrongUnit),
            Some(Ok((_, response))) if pdu::fits(request, response).is_err() => Found::Other(Event::Misfit),
            Some(Ok((_, response))) => {
                reply.whole(&[], response);
                Found::Response
            }
            Some(Err(_)) => damage(decoder, unit, request),
        };
        return (found, before + 1);
    }
    (Found::Nothing, heard.len())
}

/// What a frame was that did not come whole: the response if it begins as that does.
fn damage(decoder: &Decoder, unit: u8, request: &[u8]) -> Found {
    match (decoder.bytes(), request) {
        ([from, answered, ..], [function, ..]) if *from == unit && answered & !EXCEPTION_BIT == *function => {
            Found::Damaged
        }
        _ => Found::Other(Event::Noise),
    }
}
