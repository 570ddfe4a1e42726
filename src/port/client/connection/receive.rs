//! The receiving half of a connection: matches responses to requests, and expires requests that got none.

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
    /// Handles `count` bytes that have been read.
    pub(super) fn received(&mut self, count: usize) -> Result<(), End> {
        self.length += count;
        self.received_at = Instant::now();
        self.active = self.active.max(self.received_at);
        match self.settings.framing {
            StreamFraming::Mbap => self.take_frames(),
            StreamFraming::Rtu | StreamFraming::Capture | StreamFraming::Ssh => {
                self.take_response();
                Ok(())
            }
        }
    }

    /// Handles all complete Modbus TCP frames received so far.
    fn take_frames(&mut self) -> Result<(), End> {
        let stats = &self.dispatcher.port_state().stats;
        loop {
            if self.has_heartbeat() {
                self.drop_heartbeat();
            }
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
                // Another protocol, or a bad length: framing is lost.
                Ok(Parsed::Skip { .. }) | Err(_) => {
                    stats.count(Event::Malformed);
                    return Err(End::Lost);
                }
            };
            self.input.copy_within(consumed..self.length, 0);
            self.length -= consumed;
        }
    }

    /// Whether the device has connected by itself. Many such devices send something now and then, so that the connection stays open
    /// in a network of mobile phones.
    fn has_heartbeat(&self) -> bool {
        self.settings.listens().is_some()
    }

    /// Drops what comes before anything that may begin a response by Modbus TCP: a heartbeat has no header.
    fn drop_heartbeat(&mut self) {
        let begins = |at: &usize| {
            let rest = self.input.get(*at..self.length).unwrap_or(&[]);
            self.pending_requests.ids().any(|id| tcp::may_begin(id, rest))
        };
        let count = (0..self.length).find(begins).unwrap_or(self.length);
        if count > 0 {
            self.dispatcher.port_state().stats.count(Event::Noise);
            self.tap(false, Event::Noise, self.first(count));
            self.drop_first(count);
        }
    }

    /// Handles the RTU response once it is complete.
    fn take_response(&mut self) {
        let Some(pending) = self.pending_requests.first() else { return self.take_unsolicited() };
        let request = self.dispatcher.request(&pending.request);
        let (id, unit) = (pending.id, pending.unit);
        let outside = self.dispatcher.outside(unit);
        let received = self.input.get(..self.length).unwrap_or(&[]);
        if let Received::Complete(pdu) = rtu::response(outside, &request, received) {
            let end = rtu::end_of(pdu, received);
            match self.judge(unit, pdu, true, Event::Misfit) {
                Ok(()) => {
                    self.tap(false, Event::Response, received);
                    self.proven = true;
                    if let Some(pending) = self.pending_requests.finish(id) {
                        respond_rtu(self.dispatcher, pending, &request, pdu);
                    }
                }
                Err(event) => {
                    self.tap(false, event, received);
                    self.dispatcher.port_state().disturbed(unit, event);
                }
            }
            self.drop_first(end);
        } else if rtu::decode(received)
            .is_ok_and(|(from, pdu)| from != outside || fits(&request, pdu).is_err())
        {
            // A complete frame, but not the response: it can be judged without waiting for a pause.
            self.judge_received();
        } else if self.length >= rtu::FRAME_BYTES_MAX {
            // Longer than any frame: keep the newest part, which may contain the response.
            self.input.copy_within(self.length - rtu::FRAME_BYTES_MAX / 2..self.length, 0);
            self.length = rtu::FRAME_BYTES_MAX / 2;
        }
    }

    /// Whether a partial Modbus TCP frame is in the buffer whose rest is overdue. What follows may start anywhere in a frame, so
    /// only a new connection restores framing. The part of a heartbeat is dropped instead.
    pub(super) fn is_out_of_sync(&mut self) -> bool {
        let is_partial = self.settings.framing == StreamFraming::Mbap && self.length > 0;
        if is_partial && self.has_heartbeat() {
            if self.pending_requests.is_empty() {
                self.drop_noise();
            }
            return false;
        }
        is_partial
    }

    /// When the pause after the bytes received by RTU over TCP is long enough to judge them.
    pub(super) fn pause_end(&self) -> Instant {
        let waits = self.settings.framing == StreamFraming::Rtu && self.length > 0;
        if waits { self.received_at + RTU_PAUSE } else { Instant::MAX }
    }

    /// Judges what arrived by RTU over TCP once a pause, or the end of the response time, shows that no more follows.
    pub(super) fn judge_pause(&mut self) {
        let now = Instant::now();
        let over = self.pending_requests.first_deadline().is_some_and(|deadline| deadline <= now);
        if self.pause_end() == Instant::MAX || (self.pause_end() > now && !over) {
            return;
        }
        self.judge_received();
    }

    /// Judges the bytes received by RTU over TCP as a finished frame.
    fn judge_received(&mut self) {
        let Some(pending) = self.pending_requests.first() else { return self.judge_unsolicited() };
        let request = &self.dispatcher.request(&pending.request);
        let (id, unit) = (pending.id, pending.unit);
        let received = self.input.get(..self.length).unwrap_or(&[]);
        let judged = rtu::response_at_silence(self.dispatcher.outside(unit), request, received);
        if matches!(judged, AtSilence::Corrupt | AtSilence::Short) && self.may_go_on() {
            self.received_at = Instant::now();
            return;
        }
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
        self.tap(false, verdict, received);
        let port_state = self.dispatcher.port_state();
        match (judged, verdict) {
            (AtSilence::Complete(pdu), Event::Response) => {
                self.proven = true;
                if let Some(pending) = self.pending_requests.finish(id) {
                    respond_rtu(self.dispatcher, pending, request, pdu);
                }
            }
            (AtSilence::Noise, _) if self.has_heartbeat() => port_state.stats.count(Event::Noise),
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

    /// Whether what looks like a corrupt response may be a heartbeat, with the response behind.
    fn may_go_on(&self) -> bool {
        let deadline = self.pending_requests.first_deadline();
        self.has_heartbeat() && deadline.is_some_and(|deadline| deadline > Instant::now())
    }

    /// Accepts `response`, in a valid frame from `unit`, if it is the `expected` one; otherwise the event is `Late`, or `other`.
    fn judge(&self, unit: u8, response: &[u8], expected: bool, other: Event) -> Result<(), Event> {
        let now = Instant::now();
        let judged =
            self.dispatcher.port_state().units(|units| units.match_response(unit, response, expected, now));
        judged.map_err(|event| if event == Event::Late { event } else { other })
    }

    /// Handles bytes received while no request is in flight; a late response is judged once it is complete.
    fn take_unsolicited(&mut self) {
        if self.received_at < self.opened + self.settling() {
            // During settling, nothing can be matched.
            self.drop_noise();
        } else if self.length >= rtu::FRAME_BYTES_MAX || rtu::decode(self.first(self.length)).is_ok() {
            self.judge_unsolicited();
        }
    }

    /// Judges bytes that arrived while no request was in flight.
    pub(super) fn judge_unsolicited(&mut self) {
        let received = self.input.get(..self.length).unwrap_or(&[]);
        let Ok((unit, pdu)) = rtu::decode(received) else { return self.drop_noise() };
        let Some(unit) = self.dispatcher.inside(self.server, unit) else { return self.drop_noise() };
        let event = self.judge(unit, pdu, false, Event::Unsolicited).err().unwrap_or(Event::Unsolicited);
        self.tap(false, event, received);
        self.dispatcher.port_state().disturbed(unit, event);
        self.length = 0;
    }

    /// Handles that `pending` got no response.
    pub(super) fn failed(&self, pending: &PendingRequest<Frame<'g>>) {
        let (down_after, retries) = (self.settings.down_after, self.settings.retries);
        if self.dispatcher.is_proving(&pending.request) {
            self.dispatcher.not_proved(&pending.request, pending.unit, down_after, retries);
        } else {
            self.dispatcher.failed(&pending.request, retries);
        }
    }

    /// Drops the first `count` received bytes.
    fn drop_first(&mut self, count: usize) {
        self.input.copy_within(count.min(self.length)..self.length, 0);
        self.length = self.length.saturating_sub(count);
    }

    /// The first `count` received bytes.
    fn first(&self, count: usize) -> &[u8] {
        self.input.get(..count).unwrap_or(&[])
    }

    /// Drops received bytes that are not a response.
    pub(super) fn drop_noise(&mut self) {
        if self.length > 0 {
            self.dispatcher.port_state().stats.count(Event::Noise);
            self.tap(false, Event::Noise, self.first(self.length));
            self.length = 0;
        }
    }

    /// Expires requests past the response time-out; returns whether there were any.
    pub(super) fn expire(&mut self) -> bool {
        // Transaction ids identify late responses. RTU has none, so it needs no slots for lost ids.
        let window = match self.settings.framing {
            StreamFraming::Mbap => self.settings.late_window(),
            StreamFraming::Rtu | StreamFraming::Capture | StreamFraming::Ssh => Duration::from_ticks(0),
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

/// The pending request that a Modbus TCP frame answers; otherwise the event to count for the frame, and its unit if known.
/// `outside` maps a unit to the server's id for it.
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

/// Completes the request with `pdu` as its response.
fn respond<'g>(dispatcher: &Dispatcher<'g>, pending: PendingRequest<Frame<'g>>, pdu: &[u8]) {
    // Fits: no longer than a PDU may be.
    let _ = pending.request.replace(pdu);
    let exception = pending.request.function() & EXCEPTION_BIT != 0;
    dispatcher.port_state().answered(pending.unit, pending.sent.elapsed(), exception);
    dispatcher.done(&pending.request);
}

/// Completes the request with `pdu` as its response, unless `pdu` answers the proof sent ahead of it.
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
