//! What comes back on a connection: answers paired with their requests, and requests whose answers do not come.

use embassy_time::{Duration, Instant};

use super::{End, Link};
use crate::frame::{Cause, Frame};
use crate::hal::TcpStream;
use crate::modbus::pdu::{EXCEPTION_BIT, fits};
use crate::modbus::rtu::{self, AtSilence, Received};
use crate::modbus::tcp::{self, Header, Parsed};
use crate::port::client::dispatcher::Desk;
use crate::port::client::pending::{Flight, Flights};
use crate::port::stream::RTU_PAUSE;
use crate::settings::StreamFraming;
use crate::stats::Event;

impl<'g, S: TcpStream> Link<'_, 'g, S> {
    /// So many bytes have been read.
    pub(super) fn received(&mut self, count: usize) -> Result<(), End> {
        self.length += count;
        self.heard = Instant::now();
        self.active = self.active.max(self.heard);
        match self.settings.framing {
            StreamFraming::Mbap => self.take_frames(),
            StreamFraming::Rtu | StreamFraming::Capture => {
                self.take_response();
                Ok(())
            }
        }
    }

    /// Takes the Modbus TCP frames that have come.
    fn take_frames(&mut self) -> Result<(), End> {
        let stats = &self.desk.place().stats;
        loop {
            let consumed = match tcp::parse(self.input.get(..self.length).unwrap_or(&[])) {
                Ok(Parsed::Incomplete) => return Ok(()),
                Ok(Parsed::Frame { header, pdu, consumed }) => {
                    match pair(&mut self.flights, header, pdu, |unit| self.desk.outside(unit)) {
                        Ok(flight) => {
                            self.proven = true;
                            self.tap(false, Event::Answer, self.first(consumed));
                            answer(self.desk, flight, pdu);
                        }
                        Err((unit, event)) => {
                            self.tap(false, event, self.first(consumed));
                            match unit {
                                None => stats.count(event),
                                Some(unit) => self.desk.place().disturbed(unit, event),
                            }
                        }
                    }
                    consumed
                }
                // Nobody asked for another protocol: the border between two frames is lost.
                Ok(Parsed::Skip { .. }) | Err(_) => {
                    stats.count(Event::Malformed);
                    return Err(End::Lost);
                }
            };
            self.input.copy_within(consumed..self.length, 0);
            self.length -= consumed;
        }
    }

    /// Takes the RTU response, if it is whole.
    fn take_response(&mut self) {
        let Some(flight) = self.flights.first() else { return self.take_unawaited() };
        let request = self.desk.request(&flight.order);
        let (id, unit) = (flight.id, flight.unit);
        let outside = self.desk.outside(unit);
        let heard = self.input.get(..self.length).unwrap_or(&[]);
        if let Received::Complete(pdu) = rtu::response(outside, &request, heard) {
            let end = rtu::end_of(pdu, heard);
            match self.judge(unit, pdu, true, Event::Misfit) {
                Ok(()) => {
                    self.tap(false, Event::Answer, heard);
                    self.proven = true;
                    if let Some(flight) = self.flights.finish(id) {
                        answer_rtu(self.desk, flight, &request, pdu);
                    }
                }
                Err(event) => {
                    self.tap(false, event, heard);
                    self.desk.place().disturbed(unit, event);
                }
            }
            self.drop_first(end);
        } else if rtu::decode(heard).is_ok_and(|(from, pdu)| from != outside || fits(&request, pdu).is_err())
        {
            // A whole frame, and not that: what it is need not wait for a pause.
            self.judge_heard();
        } else if self.length >= rtu::FRAME_BYTES_MAX {
            // No frame is that long: keep the newest part, in which the response may be.
            self.input.copy_within(self.length - rtu::FRAME_BYTES_MAX / 2..self.length, 0);
            self.length = rtu::FRAME_BYTES_MAX / 2;
        }
    }

    /// Whether a part of a Modbus TCP frame is there whose rest should have come by now. What comes next may be anything, so a
    /// new connection is the way to find a frame's beginning again.
    pub(super) fn is_astray(&self) -> bool {
        self.settings.framing == StreamFraming::Mbap && self.length > 0
    }

    /// When the pause behind what came by RTU over TCP has lasted long enough to judge it.
    pub(super) fn pause_end(&self) -> Instant {
        let waits = self.settings.framing == StreamFraming::Rtu && self.length > 0;
        if waits { self.heard + RTU_PAUSE } else { Instant::MAX }
    }

    /// Judges what came by RTU over TCP when a pause, or the response time's end, says that no more comes.
    pub(super) fn judge_pause(&mut self) {
        let now = Instant::now();
        let over = self.flights.first_deadline().is_some_and(|deadline| deadline <= now);
        if self.pause_end() == Instant::MAX || (self.pause_end() > now && !over) {
            return;
        }
        self.judge_heard();
    }

    /// Judges what came by RTU over TCP as if no more came.
    fn judge_heard(&mut self) {
        let Some(flight) = self.flights.first() else { return self.judge_unawaited() };
        let request = &self.desk.request(&flight.order);
        let (id, unit) = (flight.id, flight.unit);
        let heard = self.input.get(..self.length).unwrap_or(&[]);
        let judged = rtu::response_at_silence(self.desk.outside(unit), request, heard);
        let verdict = match judged {
            AtSilence::Complete(pdu) => {
                self.judge(unit, pdu, true, Event::Misfit).err().unwrap_or(Event::Answer)
            }
            AtSilence::Damaged => Event::BadCheck,
            AtSilence::Short => Event::Short,
            AtSilence::WrongUnit(from, pdu) => {
                let from = self.desk.inside(self.server, from);
                let judged = from.map(|from| self.judge(from, pdu, false, Event::WrongUnit));
                judged.and_then(Result::err).unwrap_or(Event::WrongUnit)
            }
            AtSilence::Misfit(_, pdu) => {
                self.judge(unit, pdu, false, Event::Misfit).err().unwrap_or(Event::Misfit)
            }
            AtSilence::Noise => Event::Noise,
        };
        self.tap(false, verdict, heard);
        let place = self.desk.place();
        match (judged, verdict) {
            (AtSilence::Complete(pdu), Event::Answer) => {
                self.proven = true;
                if let Some(flight) = self.flights.finish(id) {
                    answer_rtu(self.desk, flight, request, pdu);
                }
            }
            (_, Event::BadCheck | Event::Short) => {
                self.proven = true;
                place.damaged(unit, verdict);
                if let Some(flight) = self.flights.finish(id) {
                    flight.order.blame(Cause::Damage);
                    self.failed(&flight);
                }
            }
            _ => place.disturbed(unit, verdict),
        }
        self.length = 0;
    }

    /// Whether `response`, in a good frame of `unit`, is the one that is `awaited`; if not, it is a late one, or `other`.
    fn judge(&self, unit: u8, response: &[u8], awaited: bool, other: Event) -> Result<(), Event> {
        let now = Instant::now();
        let judged = self.desk.place().units(|units| units.heard(unit, response, awaited, now));
        judged.map_err(|event| if event == Event::Late { event } else { other })
    }

    /// No response is awaited, but one may come: it is judged when it is whole.
    fn take_unawaited(&mut self) {
        if self.heard < self.opened + self.settling() {
            // What it answers, nobody knows.
            self.drop_noise();
        } else if self.length >= rtu::FRAME_BYTES_MAX || rtu::decode(self.first(self.length)).is_ok() {
            self.judge_unawaited();
        }
    }

    /// Judges what has come while no response was awaited.
    pub(super) fn judge_unawaited(&mut self) {
        let heard = self.input.get(..self.length).unwrap_or(&[]);
        let Ok((unit, pdu)) = rtu::decode(heard) else { return self.drop_noise() };
        let Some(unit) = self.desk.inside(self.server, unit) else { return self.drop_noise() };
        let event = self.judge(unit, pdu, false, Event::Unsolicited).err().unwrap_or(Event::Unsolicited);
        self.tap(false, event, heard);
        self.desk.place().disturbed(unit, event);
        self.length = 0;
    }

    /// The order of `flight` got no answer.
    pub(super) fn failed(&self, flight: &Flight<Frame<'g>>) {
        let (down_after, retries) = (self.settings.down_after, self.settings.retries);
        if self.desk.is_proving(&flight.order) {
            self.desk.not_proved(&flight.order, flight.unit, down_after, retries);
        } else {
            self.desk.failed(&flight.order, retries);
        }
    }

    /// Drops the first `count` bytes of what has come.
    fn drop_first(&mut self, count: usize) {
        self.input.copy_within(count.min(self.length)..self.length, 0);
        self.length = self.length.saturating_sub(count);
    }

    /// The first `count` bytes of what has come.
    fn first(&self, count: usize) -> &[u8] {
        self.input.get(..count).unwrap_or(&[])
    }

    /// Drops what has come and is no answer.
    pub(super) fn drop_noise(&mut self) {
        if self.length > 0 {
            self.desk.place().stats.count(Event::Noise);
            self.tap(false, Event::Noise, self.first(self.length));
            self.length = 0;
        }
    }

    /// Gives up what has waited for its answer long enough; says whether something has.
    pub(super) fn expire(&mut self) -> bool {
        // Transaction ids tell late answers from others. RTU has none, and needs no places for lost ids.
        let window = match self.settings.framing {
            StreamFraming::Mbap => self.settings.late_window(),
            StreamFraming::Rtu | StreamFraming::Capture => Duration::from_ticks(0),
        };
        let (now, open) = (Instant::now(), self.flights.len());
        while let Some(flight) = self.flights.expire(now, window) {
            if !self.desk.is_proving(&flight.order) {
                self.desk.place().timed_out(flight.unit, self.settings.down_after);
            }
            self.failed(&flight);
        }
        self.flights.len() < open
    }
}

/// The open request that a Modbus TCP frame answers; else what the frame is, and which unit was asked if that is known. Units have
/// other ids `outside`.
fn pair<'g>(
    flights: &mut Flights<Frame<'g>>,
    header: Header,
    pdu: &[u8],
    outside: impl Fn(u8) -> u8,
) -> Result<Flight<Frame<'g>>, (Option<u8>, Event)> {
    let flight = flights.find(header.transaction).ok_or((None, Event::Stray))?;
    let asked = Some(flight.unit);
    if outside(flight.unit) != header.unit {
        return Err((asked, Event::WrongUnit));
    }
    fits(&flight.order.content(), pdu).map_err(|_| (asked, Event::Misfit))?;
    flights.finish(header.transaction).ok_or((None, Event::Stray))
}

/// Sends the order home with `pdu` as its answer.
fn answer<'g>(desk: &Desk<'g>, flight: Flight<Frame<'g>>, pdu: &[u8]) {
    // It fits into the frame: it is no longer than a PDU may be.
    let _ = flight.order.replace(pdu);
    let exception = flight.order.function() & EXCEPTION_BIT != 0;
    desk.place().answered(flight.unit, flight.sent.elapsed(), exception);
    desk.done(&flight.order);
}

/// Sends the order home with `pdu` as its answer, unless that was the proof that it waited for.
fn answer_rtu<'g>(desk: &Desk<'g>, flight: Flight<Frame<'g>>, request: &[u8], pdu: &[u8]) {
    if desk.is_proving(&flight.order) {
        return desk.proved(&flight.order, flight.unit);
    }
    if pdu.first().is_some_and(|function| function & EXCEPTION_BIT == 0) {
        desk.place().units(|units| units.learn(flight.unit, request));
    }
    answer(desk, flight, pdu);
}
