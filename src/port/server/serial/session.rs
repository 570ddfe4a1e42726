//! An open line of a server-side port: receives requests, sends them to the router, and sends the responses.
//!
//! It waits for three things at a time: characters, a response from the router, and the next deadline, which is the silence that
//! ends a frame, the response delay, or the end of the response time.

use core::convert::Infallible;
use core::mem;

use embassy_futures::select::{Either3, select3};
use embassy_time::Instant;

use super::server::Server;
use crate::capture::Tap;
use crate::frame::{Frame, Stage};
use crate::hal::SerialLine;
use crate::modbus::rtu;
use crate::port::cut_through::ingress::Passing;
use crate::port::line::sniffer::{AsciiSniffer, RtuSniffer};
use crate::port::line::{Line, LineLost};
use crate::port::timer::until;
use crate::settings::Framing;
use crate::stats::Event;

mod onward;
mod receive;
mod response;

/// The open request.
enum Open<'g> {
    None,
    /// The router has it; no response is sent after `until`.
    Asked {
        received: Instant,
        until: Instant,
    },
    /// Its response is to be sent.
    Ready {
        response: Frame<'g>,
        at: Instant,
    },
}

/// An open line.
pub(super) struct Session<'s, 'g, L> {
    server: &'s Server<'s, 'g>,
    line: Line<'s, L>,
    tap: Tap<'g>,
    sniffer: Sniffer,
    open: Open<'g>,
    /// When the frame being received began, and its cut-through state.
    begun: Instant,
    passing: Passing<'g>,
    /// An ASCII frame had pauses that cannot be reproduced: the next one is not forwarded while it arrives.
    pauses: bool,
    /// This master has used functions whose frames only silence ends: no frame is cut through before its function is known.
    wary: bool,
    /// The last response sent.
    answered: Option<Answered>,
}

/// Distinguishes an echo of the gateway's response from a request that looks the same (a write's response repeats the write).
/// Without it, an adapter that receives its own transmission would make the gateway send itself requests forever, unless the
/// settings say `echo`.
struct Answered {
    unit: u8,
    /// CRC of unit and PDU.
    crc: u16,
    /// Its echo arrives before this.
    until: Instant,
}

impl Answered {
    /// Whether the frame from `unit`, `received` then, is the echo.
    fn is(&self, unit: u8, pdu: &[u8], received: Instant) -> bool {
        self.unit == unit && received < self.until && self.crc == rtu::check(unit, pdu)
    }
}

enum Sniffer {
    Rtu(RtuSniffer),
    Ascii(AsciiSniffer),
}

impl<'s, 'g, L: SerialLine> Session<'s, 'g, L> {
    /// A newly opened line, possibly in the middle of traffic.
    pub(super) fn new(server: &'s Server<'s, 'g>, line: Line<'s, L>) -> Self {
        let sniffer = match server.settings.framing {
            Framing::Rtu => Sniffer::Rtu(RtuSniffer::new()),
            Framing::Ascii => Sniffer::Ascii(AsciiSniffer::new()),
        };
        let kind = server.settings.framing.into();
        let tap = Tap { capture: server.gateway.capture(), port: server.id, kind };
        Self {
            server,
            tap,
            begun: line.active,
            line,
            sniffer,
            open: Open::None,
            passing: Passing::Whole,
            pauses: false,
            wary: false,
            answered: None,
        }
    }

    /// Serves requests until the line is lost.
    pub(super) async fn serve(&mut self) -> Result<Infallible, LineLost> {
        loop {
            let quiet = self.quiet_at();
            if L::RESTS
                && let Some(due) = self.whole_at()
            {
                // Reads here lag by at most the jitter, so a silence must last that much longer to count.
                self.line.rest(due.min(self.line.active + self.line.jitter)).await;
            }
            let due = match &self.open {
                Open::None => Instant::MAX,
                Open::Asked { until, .. } => *until,
                Open::Ready { at, .. } => *at,
            };
            let server = self.server;
            let responses = server.port_state.queue.receive(server.gateway.pool());
            let begins = self.line.received().is_empty();
            let next = due.min(quiet).min(self.passing.due());
            match select3(self.line.read(), responses, until(next)).await {
                // The board has started to relay, and detects the silence itself.
                Either3::Third(()) if self.line.is_relayed() && Instant::now() < due => {}
                Either3::First(read) => {
                    read?;
                    self.after_read(begins);
                }
                Either3::Second(frame) => self.take_response(frame),
                Either3::Third(()) if Instant::now() >= quiet => self.listen(true),
                Either3::Third(()) if self.passing.is_due() => self.proceed(),
                Either3::Third(()) => {
                    if let Some(response) = self.due() {
                        self.respond(response).await?;
                    }
                }
            }
        }
    }

    /// When all but the last character of the shortest possible frame should have arrived, unless something else is due earlier.
    /// The last one is awaited by reading: a sleep until it is due would end slightly late.
    fn whole_at(&self) -> Option<Instant> {
        let (Sniffer::Rtu(sniffer), Open::None, Passing::Whole) = (&self.sniffer, &self.open, &self.passing)
        else {
            return None;
        };
        let bytes = sniffer.at_least(self.line.received(), |unit| self.server.is_ours(unit))?;
        Some(self.line.begun() + self.line.settings.chars(bytes - 1))
    }

    /// When a silence becomes significant for the bytes received.
    fn quiet_at(&self) -> Instant {
        let waits = match &self.sniffer {
            Sniffer::Rtu(sniffer) => sniffer.needs_silence() || !self.line.received().is_empty(),
            Sniffer::Ascii(sniffer) => sniffer.in_frame(),
        };
        let silence = self.server.settings.framing.silence(self.line.settings) + self.line.jitter;
        if waits { self.line.quiet_at(silence) } else { Instant::MAX }
    }

    /// Handles a frame returned by the router: the expected response, a request without response, or a response that is too late.
    fn take_response(&mut self, response: Frame<'g>) {
        let envelope = response.envelope();
        let is_expected = envelope.origin.generation == self.server.port_state.generation();
        self.open = match (&self.open, envelope.stage) {
            (Open::Asked { .. }, Stage::Silence) if is_expected => Open::None,
            (Open::Asked { received, .. }, _) if is_expected => {
                let delay = self.server.settings.server.reply_delay;
                Open::Ready { at: self.line.silent_at().max(*received + delay), response }
            }
            _ => return self.server.port_state.stats.count(Event::RequesterGone),
        };
    }

    /// Handles the deadline of the open request: returns its response to send, or ends it.
    fn due(&mut self) -> Option<Frame<'g>> {
        match mem::replace(&mut self.open, Open::None) {
            Open::Ready { response, .. } => return Some(response),
            Open::Asked { .. } => {
                self.server.port_state.renew();
                self.server.port_state.stats.count(Event::Timeout);
            }
            Open::None => {}
        }
        None
    }
}
