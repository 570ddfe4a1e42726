//! The receiving half of a session: forwards bytes as they arrive, classifies them, and recognises requests.

use embassy_time::Instant;
use heapless::Vec;

use super::{Open, Session, Sniffer};
use crate::hal::SerialLine;
use crate::modbus::ascii::COLON;
use crate::modbus::{PDU_BYTES_MAX, rtu};
use crate::port::cut_through::ingress::Passing;
use crate::port::line::sniffer::Sniffed;
use crate::stats::{Event, LastError};

/// The verdict, copied so that the line's buffer can be consumed.
enum Judged {
    Nothing,
    /// A request.
    Request(u8),
    /// A request that has been cut through.
    Passed,
    /// The gateway's own last transmission.
    Echo,
    Foreign,
    Garbage(LastError),
}

/// A request's PDU.
type Request = Vec<u8, PDU_BYTES_MAX>;

/// Garbage shorter than any frame: stray bits, as from drivers that switch the line.
const STRAY_BYTES_MAX: usize = rtu::FRAME_BYTES_MIN - 1;

impl<L: SerialLine> Session<'_, '_, L> {
    /// Forwards and classifies what has just been read; `begins`: the buffer was empty before.
    pub(super) fn after_read(&mut self, begins: bool) {
        if !self.is_stray() {
            self.interrupted();
        }
        if let Sniffer::Ascii(_) = self.sniffer {
            self.watch_pauses();
            self.listen(false);
            return self.proceed();
        }
        if begins {
            self.begin();
        }
        self.proceed();
        // Where reads keep up with the wire, only silence ends a frame that is not cut through.
        if self.line.jitter.as_ticks() > 0 {
            self.listen(false);
        }
    }

    /// Forwards the bytes received, and classifies them once the whole frame has been forwarded.
    pub(super) fn proceed(&mut self) {
        if self.pass_on() {
            self.listen(false);
            // Complete but not accepted: not a request.
            self.passing = Passing::Whole;
        }
    }

    /// Whether the bytes may be stray bits right after a request that ended with its last character.
    fn is_stray(&self) -> bool {
        let few = self.line.received().len() <= STRAY_BYTES_MAX;
        few && matches!(self.open, Open::Asked { received, .. } if !self.is_separated(received))
    }

    /// Whether the bytes began after a silence since `active`, or nearly so.
    fn is_separated(&self, active: Instant) -> bool {
        self.line.begun() >= active + self.line.settings.gap() / 2
    }

    /// Ends the open request, as something was received: the master no longer waits for its response.
    fn interrupted(&mut self) {
        if let Open::Ready { .. } = self.open {
            self.server.port_state.stats.count(Event::RequesterGone);
        }
        if !matches!(self.open, Open::None) {
            self.server.port_state.renew();
            self.open = Open::None;
        }
    }

    /// Classifies the bytes received so far.
    pub(super) fn listen(&mut self, silent: bool) {
        loop {
            if let (Sniffer::Ascii(_), Some(&COLON)) = (&self.sniffer, self.line.received().first()) {
                self.begin();
            }
            let mut request = Request::new();
            let (judged, count) = self.judge(silent, &mut request);
            // Whatever follows a request supersedes it, even if both are read at once.
            if count > STRAY_BYTES_MAX {
                self.interrupted();
            }
            let event = match judged {
                Judged::Nothing if count > 0 && !self.line.received().is_empty() => continue,
                Judged::Nothing => break,
                Judged::Echo => Event::Noise,
                Judged::Passed | Judged::Request(_) => {
                    let received = self.line.active;
                    let asked = match judged {
                        Judged::Request(unit) => self.server.ask(unit, &request, received),
                        _ => true,
                    };
                    if asked {
                        let until = received + self.server.settings.server.answer_within;
                        self.open = Open::Asked { received, until };
                    }
                    continue;
                }
                Judged::Foreign => Event::Foreign,
                Judged::Garbage(error) => {
                    self.server.port_state.stats.note(error);
                    if error == LastError::Checksum { Event::Corrupt } else { Event::Noise }
                }
            };
            self.server.port_state.stats.count(event);
            self.passing = Passing::Whole;
        }
        // The start of the next frame.
        if !self.line.received().is_empty() && !self.is_stray() {
            self.interrupted();
        }
    }

    /// The next item received, and its length. The PDU of a request for the gateway that was not cut through goes to `request`.
    fn judge(&mut self, silent: bool, request: &mut Request) -> (Judged, usize) {
        let Self { server, line, tap, sniffer, passing, answered, .. } = self;
        let is_ours = |unit| server.is_ours(unit);
        let (sniffed, count) = match sniffer {
            Sniffer::Rtu(sniffer) => sniffer.feed(line.received(), silent, is_ours),
            Sniffer::Ascii(sniffer) if silent && sniffer.in_frame() => (sniffer.overdue(), 0),
            Sniffer::Ascii(sniffer) => sniffer.feed(line.received(), is_ours),
        };
        let judged = match sniffed {
            Sniffed::Request { unit, pdu }
                if answered.take().is_some_and(|own| own.is(unit, pdu, line.active)) =>
            {
                Judged::Echo
            }
            Sniffed::Request { pdu, .. } if server.finish(passing, pdu, line.active) => Judged::Passed,
            Sniffed::Request { unit, pdu } => {
                // Fits: no longer than a PDU may be.
                let _ = request.extend_from_slice(pdu);
                Judged::Request(unit)
            }
            Sniffed::ForeignRequest | Sniffed::ForeignResponse => Judged::Foreign,
            Sniffed::Garbage(error) => Judged::Garbage(error),
            Sniffed::Nothing => Judged::Nothing,
        };
        let verdict = match judged {
            Judged::Nothing => None,
            Judged::Request(_) | Judged::Passed | Judged::Echo => Some(Event::Request),
            Judged::Foreign => Some(Event::Foreign),
            Judged::Garbage(LastError::Checksum) => Some(Event::Corrupt),
            Judged::Garbage(_) => Some(Event::Noise),
        };
        if let Some(verdict) = verdict {
            tap.received(line.active, verdict, line.received().get(..count).unwrap_or(&[]));
        }
        line.consume(count);
        (judged, count)
    }
}
