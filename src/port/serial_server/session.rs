//! An open line of a server-side port: hears, asks the router, answers.
//!
//! It waits for three things at a time: characters, an answer from the router, and the next moment at which something is
//! due: the silence that ends a frame, the moment to answer, or the end of the master's patience.

use core::convert::Infallible;
use core::mem;

use embassy_futures::select::{Either3, select3};
use embassy_time::{Instant, Timer};

use super::Server;
use crate::config::Framing;
use crate::frame::{Frame, Stage};
use crate::hal::SerialLine;
use crate::modbus::ascii::COLON;
use crate::modbus::crc::crc16;
use crate::modbus::{PDU_BYTES_MAX, rtu};
use crate::port::arriving::Passing;
use crate::port::line::{Line, LineLost};
use crate::port::shared_bus::{AsciiEar, Heard, RtuEar};
use crate::stats::{Event, LastError};

mod answer;
mod onward;

/// The request that is open.
enum Open<'g> {
    None,
    /// The router has it; there is no answer after `until`.
    Asked {
        received: Instant,
        until: Instant,
    },
    /// Its answer is to be sent.
    Ready {
        answer: Frame<'g>,
        at: Instant,
    },
}

/// What was judged, copied so that the line can go on.
enum Judged {
    Nothing,
    Request(u8),
    Foreign,
    Garbage(LastError),
}

/// Garbage shorter than any frame: stray bits, as drivers make them that switch the line.
const STRAY_BYTES_MAX: usize = rtu::FRAME_BYTES_MIN - 1;

/// An open line.
pub(super) struct Session<'s, 'g, L> {
    server: &'s Server<'s, 'g>,
    line: Line<'s, L>,
    ear: Ear,
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

/// What tells an answer from the request that repeats it (a write's answer is the write): an adapter that hears itself
/// would otherwise have the gateway ask itself for ever, unless the settings say `echo`.
struct Answered {
    unit: u8,
    crc: u16,
    /// Its echo is heard before.
    until: Instant,
}

enum Ear {
    Rtu(RtuEar),
    Ascii(AsciiEar),
}

impl<'s, 'g, L: SerialLine> Session<'s, 'g, L> {
    /// A line that was just opened, in the middle of whatever happens on it.
    pub(super) fn new(server: &'s Server<'s, 'g>, line: Line<'s, L>) -> Self {
        let ear = match server.settings.framing {
            Framing::Rtu => Ear::Rtu(RtuEar::new()),
            Framing::Ascii => Ear::Ascii(AsciiEar::new()),
        };
        Self {
            server,
            begun: line.active,
            line,
            ear,
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
            let due = match &self.open {
                Open::None => Instant::MAX,
                Open::Asked { until, .. } => *until,
                Open::Ready { at, .. } => *at,
            };
            let server = self.server;
            let answers = server.place.queue.receive(server.gateway.pool());
            let begins = self.line.heard().is_empty();
            let until = due.min(quiet).min(self.passing.due());
            match select3(self.line.read(), answers, Timer::at(until)).await {
                Either3::First(read) => {
                    read?;
                    self.hear(begins);
                }
                Either3::Second(frame) => self.take_answer(frame),
                Either3::Third(()) if Instant::now() >= quiet => self.listen(true),
                Either3::Third(()) if self.passing.is_due() => self.proceed(),
                Either3::Third(()) => self.due().await?,
            }
        }
    }

    /// Passes on and judges what has just been read; `begins`: nothing else had been heard.
    fn hear(&mut self, begins: bool) {
        if !self.is_stray() {
            self.interrupted();
        }
        if let Ear::Ascii(_) = self.ear {
            self.watch_pauses();
            self.listen(false);
            return self.proceed();
        }
        if begins {
            self.begin();
        }
        self.proceed();
        // Where reads keep up with the wire, only silence ends a frame that has not been passed on.
        if self.line.jitter.as_ticks() > 0 {
            self.listen(false);
        }
    }

    /// Passes on what has been heard, and judges it if it has been passed on to its end.
    fn proceed(&mut self) {
        if self.pass_on() {
            self.listen(false);
            // What is whole and has not been judged a request is none.
            self.passing = Passing::Whole;
        }
    }

    /// When the silence will say something about what has been heard.
    fn quiet_at(&self) -> Instant {
        let waits = match &self.ear {
            Ear::Rtu(ear) => ear.needs_silence() || !self.line.heard().is_empty(),
            Ear::Ascii(ear) => ear.in_frame(),
        };
        let silence = self.server.settings.framing.silence(&self.line.settings) + self.line.jitter;
        if waits { self.line.active + silence } else { Instant::MAX }
    }

    /// Whether what has been heard may be stray bits right behind a request that was over at its last character.
    fn is_stray(&self) -> bool {
        let few = self.line.heard().len() <= STRAY_BYTES_MAX;
        few && matches!(self.open, Open::Asked { received, .. } if !self.is_apart(received))
    }

    /// Whether what is being heard began after a silence since `active`, or nearly so.
    fn is_apart(&self, active: Instant) -> bool {
        self.line.begun() >= active + self.line.settings.gap() / 2
    }

    /// Something was heard while a request was open: the master does not wait for its answer any more.
    fn interrupted(&mut self) {
        if let Open::Ready { .. } = self.open {
            self.server.place.stats.count(Event::AskerGone);
        }
        if !matches!(self.open, Open::None) {
            self.server.place.renew();
            self.open = Open::None;
        }
    }

    /// Judges what has been heard so far.
    fn listen(&mut self, silent: bool) {
        loop {
            if let (Ear::Ascii(_), Some(&COLON)) = (&self.ear, self.line.heard().first()) {
                self.begin();
            }
            let mut request = [0; PDU_BYTES_MAX];
            let (judged, count, request) = self.judge(silent, &mut request);
            // What comes behind a request overtakes it, also when both were heard at once.
            if count > STRAY_BYTES_MAX {
                self.interrupted();
            }
            let event = match judged {
                Judged::Nothing if count > 0 && !self.line.heard().is_empty() => continue,
                Judged::Nothing => break,
                Judged::Request(unit) if self.is_echo(unit, request) => Event::Noise,
                Judged::Request(unit) => {
                    let received = self.line.active;
                    if self.finish(request, received) || self.server.ask(unit, request, received) {
                        let until = received + self.server.settings.server.answer_within;
                        self.open = Open::Asked { received, until };
                    }
                    continue;
                }
                Judged::Foreign => Event::Foreign,
                Judged::Garbage(error) => {
                    self.server.place.stats.note(error);
                    if error == LastError::Checksum { Event::Damaged } else { Event::Noise }
                }
            };
            self.server.place.stats.count(event);
            self.passing = Passing::Whole;
        }
        // The beginning of the next frame.
        if !self.line.heard().is_empty() && !self.is_stray() {
            self.interrupted();
        }
    }

    /// Whether this is what the gateway itself has just sent.
    fn is_echo(&mut self, unit: u8, pdu: &[u8]) -> bool {
        let answered = self.answered.take();
        answered.is_some_and(|own| own.unit == unit && self.line.active < own.until && own.crc == crc16(pdu))
    }

    /// The next thing that was heard, how many bytes that were, and its PDU if it is a request for us.
    fn judge<'b>(&mut self, silent: bool, request: &'b mut [u8; PDU_BYTES_MAX]) -> (Judged, usize, &'b [u8]) {
        let Self { server, line, ear, .. } = self;
        let is_ours = |unit| server.is_ours(unit);
        let (heard, count) = match ear {
            Ear::Rtu(ear) => ear.hear(line.heard(), silent, is_ours),
            Ear::Ascii(ear) if silent && ear.in_frame() => (ear.overdue(), 0),
            Ear::Ascii(ear) => ear.hear(line.heard(), is_ours),
        };
        let mut length = 0;
        let judged = match heard {
            Heard::Request { unit, pdu } => {
                request.iter_mut().zip(pdu).for_each(|(place, byte)| *place = *byte);
                length = pdu.len();
                Judged::Request(unit)
            }
            Heard::ForeignRequest | Heard::ForeignAnswer => Judged::Foreign,
            Heard::Garbage(error) => Judged::Garbage(error),
            Heard::Nothing => Judged::Nothing,
        };
        line.consume(count);
        (judged, count, request.get(..length).unwrap_or_default())
    }

    /// A frame has come home: the answer that is waited for, a request that gets none, or what is too late.
    fn take_answer(&mut self, answer: Frame<'g>) {
        let envelope = answer.envelope();
        let is_awaited = envelope.origin.generation == self.server.place.generation();
        self.open = match (&self.open, envelope.stage) {
            (Open::Asked { .. }, Stage::Silence) if is_awaited => Open::None,
            (Open::Asked { received, .. }, _) if is_awaited => {
                let delay = self.server.settings.server.reply_delay;
                Open::Ready { at: self.line.silent_at().max(*received + delay), answer }
            }
            _ => return self.server.place.stats.count(Event::AskerGone),
        };
    }

    /// The open request's time has come: its answer is sent, or there will be none.
    async fn due(&mut self) -> Result<(), LineLost> {
        match mem::replace(&mut self.open, Open::None) {
            Open::Ready { answer, .. } => self.answer(answer).await,
            Open::Asked { .. } => {
                self.server.place.renew();
                self.server.place.stats.count(Event::Timeout);
                Ok(())
            }
            Open::None => Ok(()),
        }
    }
}
