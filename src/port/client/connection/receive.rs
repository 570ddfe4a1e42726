//! What comes back on a connection: answers paired with their requests, and requests whose answers do not come.

use embassy_time::{Duration, Instant};

use super::{End, TcpConnection};
use crate::frame::{Cause, Frame};
use crate::hal::TcpStream;
use crate::modbus::pdu::{EXCEPTION_BIT, fits};
use crate::modbus::rtu::{self, AtSilence, Received};
use crate::modbus::tcp::{self, Header, Parsed};
use crate::port::client::dispatcher::Dispatcher;
use crate::port::client::pending::{PendingRequest, PendingRequests};
use crate::port::stream::RTU_PAUSE;
use crate::settings::StreamFraming;
use crate::stats::Event;

impl<'g, S: TcpStream> TcpConnection<'_, 'g, S> {
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
        let stats = &self.dispatcher.port_state().stats;
        loop {
            let consumed = match tcp::parse(self.input.get(..self.length).unwrap_or(&[])) {
                Ok(Parsed::Incomplete) => return Ok(()),
                Ok(Parsed::Frame { header, pdu, consumed }) => {
                    match pair(&mut self.pending_requests, header, pdu, |unit| self.dispatcher.outside(unit))
                    {
                        Ok(pending) => {
                            self.proven = true;
                            self.tap(false, Event::Response, self.first(consumed));
                            respond(self.dispatcher, pending, pdu);
                        }
                        Err((unit, event)) => {
                            self.tap(false, event, self.first(consumed));
                            match unit {
                                None => stats.count(event),
                                Some(unit) => self.dispatcher.port_state().disturbed(unit, event),
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
        let Some(pending) = self.pending_requests.first() else { return self.take_unawaited() };
        let request = self.dispatcher.request(&pending.request);
        let (id, unit) = (pending.id, pending.unit);
        let outside = self.dispatcher.outside(unit);
        let heard = self.input.get(..self.length).unwrap_or(&[]);
        if let Received::Complete(pdu) = rtu::response(outside, &request, heard) {
            let end = rtu::end_of(pdu, heard);
            match self.judge(unit, pdu, true, Event::Misfit) {
                Ok(()) => {
                    self.tap(false, Event::Response, heard);
                    self.proven = true;
                    if let Some(pending) = self.pending_requests.finish(id) {
                        respond_rtu(self.dispatcher, pending, &request, pdu);
                    }
                }
                Err(event) => {
                    self.tap(false, event, heard);
                    self.dispatcher.port_state().disturbed(unit, event);
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
        let over = self.pending_requests.first_deadline().is_some_and(|deadline| deadline <= now);
        if self.pause_end() == Instant::MAX || (self.pause_end() > now && !over) {
            return;
        }
        self.judge_heard();
    }

    /// Judges what came by RTU over TCP as if no more came.
    fn judge_heard(&mut self) {
        let Some(pending) = self.pending_requests.first() else { return self.judge_unawaited() };
        let request = &self.dispatcher.request(&pending.request);
        let (id, unit) = (pending.id, pending.unit);
        let heard = self.input.get(..self.length).unwrap_or(&[]);
        let judged = rtu::response_at_silence(self.dispatcher.outside(unit), request, heard);
        let verdict = match judged {
            AtSilence::Complete(pdu) => {
                self.judge(unit, pdu, true, Event::Misfit).err().unwrap_or(Event::Response)
            }
            AtSilence::Corrupt => Event::BadCheck,
            AtSilence::Short => Event::Short,
            AtSilence::WrongUnit(from, pdu) => {
                let from = self.dispatcher.inside(self.server, from);
                let judged = from.map(|from| self.judge(from, pdu, false, Event::WrongUnit));
                judged.and_then(Result::err).unwrap_or(Event::WrongUnit)
            }
            AtSilence::Misfit(_, pdu) => {
                self.judge(unit, pdu, false, Event::Misfit).err().unwrap_or(Event::Misfit)
            }
            AtSilence::Noise => Event::Noise,
        };
        self.tap(false, verdict, heard);
        let port_state = self.dispatcher.port_state();
        match (judged, verdict) {
            (AtSilence::Complete(pdu), Event::Response) => {
                self.proven = true;
                if let Some(pending) = self.pending_requests.finish(id) {
                    respond_rtu(self.dispatcher, pending, request, pdu);
                }
            }
            (_, Event::BadCheck | Event::Short) => {
                self.proven = true;
                port_state.corrupt(unit, verdict);
                if let Some(pending) = self.pending_requests.finish(id) {
                    pending.request.blame(Cause::Corruption);
                    self.failed(&pending);
                }
            }
            _ => port_state.disturbed(unit, verdict),
        }
        self.length = 0;
    }

    /// Whether `response`, in a good frame of `unit`, is the one that is `awaited`; if not, it is a late one, or `other`.
    fn judge(&self, unit: u8, response: &[u8], awaited: bool, other: Event) -> Result<(), Event> {
        let now = Instant::now();
        let judged = self.dispatcher.port_state().units(|units| units.heard(unit, response, awaited, now));
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
        let Some(unit) = self.dispatcher.inside(self.server, unit) else { return self.drop_noise() };
        let event = self.judge(unit, pdu, false, Event::Unsolicited).err().unwrap_or(Event::Unsolicited);
        self.tap(false, event, heard);
        self.dispatcher.port_state().disturbed(unit, event);
        self.length = 0;
    }

    /// The order of `pending` got no response.
    pub(super) fn failed(&self, pending: &PendingRequest<Frame<'g>>) {
        let (down_after, retries) = (self.settings.down_after, self.settings.retries);
        if self.dispatcher.is_proving(&pending.request) {
            self.dispatcher.not_proved(&pending.request, pending.unit, down_after, retries);
        } else {
            self.dispatcher.failed(&pending.request, retries);
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

    /// Drops what has come and is no response.
    pub(super) fn drop_noise(&mut self) {
        if self.length > 0 {
            self.dispatcher.port_state().stats.count(Event::Noise);
            self.tap(false, Event::Noise, self.first(self.length));
            self.length = 0;
        }
    }

    /// Gives up what has waited for its response long enough; says whether something has.
    pub(super) fn expire(&mut self) -> bool {
        // Transaction ids tell late responses from others. RTU has none, and needs no places for lost ids.
        let window = match self.settings.framing {
            StreamFraming::Mbap => self.settings.late_window(),
            StreamFraming::Rtu | StreamFraming::Capture => Duration::from_ticks(0),
        };
        let (now, open) = (Instant::now(), self.pending_requests.len());
        while let Some(pending) = self.pending_requests.expire(now, window) {
            if !self.dispatcher.is_proving(&pending.request) {
                self.dispatcher.port_state().timed_out(pending.unit, self.settings.down_after);
            }
            self.failed(&pending);
        }
        self.pending_requests.len() < open
    }
}

/// The open request that a Modbus TCP frame answers; else what the frame is, and which unit was asked if that is known. Units have
/// other ids `outside`.
fn pair<'g>(
    pending_requests: &mut PendingRequests<Frame<'g>>,
    header: Header,
    pdu: &[u8],
    outside: impl Fn(u8) -> u8,
) -> Result<PendingRequest<Frame<'g>>, (Option<u8>, Event)> {
    let pending = pending_requests.find(header.transaction).ok_or((None, Event::Stray))?;
    let asked = Some(pending.unit);
    if outside(pending.unit) != header.unit {
        return Err((asked, Event::WrongUnit));
    }
    fits(&pending.request.content(), pdu).map_err(|_| (asked, Event::Misfit))?;
    pending_requests.finish(header.transaction).ok_or((None, Event::Stray))
}

/// Sends the request home with `pdu` as its response.
fn respond<'g>(dispatcher: &Dispatcher<'g>, pending: PendingRequest<Frame<'g>>, pdu: &[u8]) {
    // It fits into the frame: it is no longer than a PDU may be.
    let _ = pending.request.replace(pdu);
    let exception = pending.request.function() & EXCEPTION_BIT != 0;
    dispatcher.port_state().answered(pending.unit, pending.sent.elapsed(), exception);
    dispatcher.done(&pending.request);
}

/// Sends the request home with `pdu` as its response, unless that was the proof that it waited for.
fn respond_rtu<'g>(
    dispatcher: &Dispatcher<'g>,
    pending: PendingRequest<Frame<'g>>,
    request: &[u8],
    pdu: &[u8],
) {
    if dispatcher.is_proving(&pending.request) {
        return dispatcher.proved(&pending.request, pending.unit);
    }
    if pdu.first().is_some_and(|function| function & EXCEPTION_BIT == 0) {
        dispatcher.port_state().units(|units| units.learn(pending.unit, request));
    }
    respond(dispatcher, pending, pdu);
}
