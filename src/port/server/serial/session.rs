//! An open line of a server-side port: hears, asks the router, answers.
//!
//! It waits for three things at a time: characters, a response from the router, and the next moment at which something is
//! due: the silence that ends a frame, the moment to answer, or the end of the master's patience.

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

/// The request that is open.
enum Open<'g> {
    None,
    /// The router has it; there is no response after `until`.
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
    /// When the frame that is being heard began, and how far it has been passed on.
    begun: Instant,
    passing: Passing<'g>,
    /// An ASCII frame had pauses in it that no copy of it could have: the next one is not begun.
    pauses: bool,
    /// This master has used functions whose end only silence tells: no frame is begun before its function is known.
    wary: bool,
    /// The latest answer.
    answered: Option<Answered>,
}

/// What tells a response from the request that repeats it (a write's response is the write): an adapter that hears itself
/// would otherwise have the gateway ask itself for ever, unless the settings say `echo`.
struct Answered {
    unit: u8,
    /// Of unit and PDU.
    crc: u16,
    /// Its echo is heard before.
    until: Instant,
}

impl Answered {
    /// Whether it is what was heard of `unit` until `heard`.
    fn is(&self, unit: u8, pdu: &[u8], received: Instant) -> bool {
        self.unit == unit && received < self.until && self.crc == rtu::check(unit, pdu)
    }
}

enum Sniffer {
    Rtu(RtuSniffer),
    Ascii(AsciiSniffer),
}

impl<'s, 'g, L: SerialLine> Session<'s, 'g, L> {
    /// A line that was just opened, in the middle of whatever happens on it.
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

    /// Hears and answers until the line is lost.
    pub(super) async fn serve(&mut self) -> Result<Infallible, LineLost> {
        loop {
            let quiet = self.quiet_at();
            if L::RESTS
                && let Some(due) = self.whole_at()
            {
                // What is read afterwards is read late, but no later than reads may be here: as much longer must a silence last
                // to be believed.
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
                // Meanwhile the board has begun to pass on what comes, and to watch for a silence in it.
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

    /// When the frame that is being heard will have all but the last one of the characters that it has at least, if nothing
    /// is to be done before. That one is waited for: a sleep until it is due would end a little later than it comes.
    fn whole_at(&self) -> Option<Instant> {
        let (Sniffer::Rtu(sniffer), Open::None, Passing::Whole) = (&self.sniffer, &self.open, &self.passing)
        else {
            return None;
        };
        let bytes = sniffer.at_least(self.line.received(), |unit| self.server.is_ours(unit))?;
        Some(self.line.begun() + self.line.settings.chars(bytes - 1))
    }

    /// When the silence will say something about what has been heard.
    fn quiet_at(&self) -> Instant {
        let waits = match &self.sniffer {
            Sniffer::Rtu(sniffer) => sniffer.needs_silence() || !self.line.received().is_empty(),
            Sniffer::Ascii(sniffer) => sniffer.in_frame(),
        };
        let silence = self.server.settings.framing.silence(self.line.settings) + self.line.jitter;
        if waits { self.line.quiet_at(silence) } else { Instant::MAX }
    }

    /// A frame has come home: the response that is waited for, a request that gets none, or what is too late.
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

    /// The open request's time has come: its response, which is to be sent, or there will be none.
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
