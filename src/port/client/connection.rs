//! One open connection to an outside server: sends the dispatcher's requests and matches the responses to them.
//!
//! Modbus TCP allows several requests in flight. A response is accepted only if its transaction id belongs to a pending request
//! and its unit, function, length and echoed fields match that request; everything else is dropped and counted, and leaves the
//! response timers running. RTU over TCP allows one request in flight, and its response ends by length and CRC, or by the pause
//! after it.

use core::convert::Infallible;
use core::pin::pin;
use core::task::Poll;

use embassy_futures::poll_once;
use embassy_futures::select::{Either4, select4};
use embassy_time::{Duration, Instant};

use crate::capture::Tap;
use crate::frame::{Cause, Frame};
use crate::gateway::socket::Socket;
use crate::hal::TcpStream;
use crate::modbus::pdu;
use crate::modbus::tcp::{ADU_BYTES_MAX, Header};
use crate::port::client::dispatcher::{Dispatcher, is_responding};
use crate::port::client::pending::PendingRequests;
use crate::port::client::queue::{BROADCAST, Next};
use crate::port::stream::Pieces;
use crate::port::timer::{until, within};
use crate::settings::{StreamFraming, TcpClientSettings};
use crate::stats::Event;

mod receive;

/// Pause after a broadcast by RTU over TCP: the turnaround delay of the line behind the server (Serial Line 2.4.1).
const TURNAROUND: Duration = Duration::from_millis(100);
/// Bytes that may arrive between a request and the end of its response: one frame, and half a frame of noise.
const INPUT_BYTES_MAX: usize = ADU_BYTES_MAX + ADU_BYTES_MAX / 2;
/// A connection that stayed open this long without a request counts as successful even though the server closed it.
const SETTLED: Duration = Duration::from_secs(1);

/// An open connection.
pub(crate) struct TcpConnection<'l, 'g, S> {
    dispatcher: &'l Dispatcher<'g>,
    settings: &'l TcpClientSettings,
    stream: S,
    pending_requests: PendingRequests<Frame<'g>>,
    /// The port's connection number, and the server's number.
    connection: u8,
    server: usize,
    socket: &'l Socket,
    input: [u8; INPUT_BYTES_MAX],
    length: usize,
    opened: Instant,
    /// Last time anything was sent or received.
    active: Instant,
    /// Last time a request was sent.
    used: Instant,
    /// Last time anything was received.
    received_at: Instant,
    /// Whether a request has been sent.
    asked: bool,
    /// Whether a request has been answered.
    proven: bool,
    /// The previous connection may have left reads unanswered, which are repeated on this one.
    lost: bool,
    /// The socket is needed elsewhere.
    leaving: bool,
}

/// What the connection does next.
enum Step<'g> {
    /// Sends this request to this unit.
    Send(Frame<'g>, u8),
    /// Waits until this time, or until something happens.
    Wait(Instant),
}

/// Why a connection ends.
pub(crate) enum End {
    /// It is not needed any more.
    Unused,
    /// The server closed it, or it broke.
    Lost,
}

impl<'l, 'g, S: TcpStream> TcpConnection<'l, 'g, S> {
    /// A newly opened connection; `first` is its first transaction id.
    pub(crate) fn new(
        dispatcher: &'l Dispatcher<'g>,
        settings: &'l TcpClientSettings,
        stream: S,
        first: u16,
        (connection, server): (u8, usize),
        socket: &'l Socket,
    ) -> Self {
        let now = Instant::now();
        Self {
            dispatcher,
            settings,
            stream,
            pending_requests: PendingRequests::new(first, settings.timeout),
            connection,
            server,
            socket,
            input: [0; INPUT_BYTES_MAX],
            length: 0,
            opened: now,
            active: now,
            used: now,
            received_at: now,
            asked: false,
            proven: false,
            lost: true,
            leaving: false,
        }
    }

    /// Settles what was in flight when the connection ended; returns whether the server seems healthy.
    ///
    /// Requests in flight may have been executed, so they get 0Bh, except reads that may be repeated. Reads on a connection that
    /// has delivered other responses stay with the dispatcher, like requests not sent yet: many servers close after a response,
    /// before they process what has been sent meanwhile. The next connection sends those reads first.
    pub(crate) fn ended(&mut self, end: End) -> bool {
        let cut = !self.pending_requests.is_empty();
        let closed = self.proven && self.length == 0;
        while let Some(pending) = self.pending_requests.pop() {
            if closed && pending.request.pdu(pdu::is_read) && !is_responding(&pending.request) {
                self.dispatcher.port_state().stats.count(Event::Retry);
                // Without transaction ids, a proof must first show that no late response is still on its way.
                if self.settings.framing == StreamFraming::Rtu {
                    self.dispatcher.requeue(&pending.request);
                }
                continue;
            }
            pending.request.blame(Cause::Connection);
            self.failed(&pending);
        }
        match end {
            End::Unused => true,
            End::Lost => {
                self.dispatcher.port_state().stats.count(if cut { Event::LineLost } else { Event::Left });
                self.proven || (!cut && self.opened.elapsed() >= SETTLED)
            }
        }
    }

    /// Returns the stream, so that the caller can close it.
    pub(crate) fn into_stream(self) -> S {
        self.stream
    }

    /// Serves requests until the connection ends.
    pub(crate) async fn serve(&mut self) -> Result<Infallible, End> {
        let socket = self.socket;
        loop {
            self.judge_pause();
            if self.expire() && self.is_out_of_sync() {
                return Err(End::Lost);
            }
            let due = loop {
                // Detects that the server has closed before the next request is written to a dead connection.
                let space = self.input.get_mut(self.length..).filter(|space| !space.is_empty());
                let read = space.map_or(Poll::Pending, |space| poll_once(self.stream.read(space)));
                if let Poll::Ready(read) = read {
                    self.take(read.unwrap_or(0))?;
                    continue;
                }
                let now = Instant::now();
                let (request, unit) = match self.step(now)? {
                    Step::Send(request, unit) => (request, unit),
                    Step::Wait(due) => break due,
                };
                self.send(request, unit, now).await?;
            };
            if socket.busy(!self.pending_requests.is_empty() || self.begins()) {
                // This connection may have to close in favour of another server.
                self.dispatcher.make_room();
            }
            let deadline = self.pending_requests.first_deadline().unwrap_or(Instant::MAX);
            let wake = due.min(deadline).min(self.pause_end());
            let space = self.input.get_mut(self.length..).unwrap_or(&mut []);
            let read = self.stream.read(space);
            match select4(read, self.dispatcher.changed(self.connection), until(wake), socket.leave.wait())
                .await
            {
                Either4::First(read) => self.take(read.unwrap_or(0))?,
                Either4::Second(()) | Either4::Third(()) => {}
                Either4::Fourth(()) => self.leaving = true,
            }
        }
    }

    /// Handles `count` bytes that have been read; 0 means end of stream.
    fn take(&mut self, count: usize) -> Result<(), End> {
        if count == 0 { Err(End::Lost) } else { self.received(count) }
    }

    /// Whether nothing has been sent yet but a request is waiting: a connection opened for a request serves it before it may be
    /// closed.
    fn begins(&self) -> bool {
        !self.asked && self.dispatcher.is_wanted(self.server)
    }

    /// The next step at `now`.
    fn step(&mut self, now: Instant) -> Result<Step<'g>, End> {
        if self.leaving && !self.begins() {
            return if self.pending_requests.is_empty() {
                Err(End::Unused)
            } else {
                Ok(Step::Wait(Instant::MAX))
            };
        }
        if self.pending_requests.len() >= usize::from(self.settings.in_flight) {
            return Ok(Step::Wait(Instant::MAX));
        }
        let Some(room) = self.pending_requests.room(now) else { return Ok(Step::Wait(Instant::MAX)) };
        let rested = self.active + self.settings.request_delay;
        let due = room.max(rested).max(self.opened + self.settling());
        if due > now {
            return Ok(Step::Wait(due));
        }
        if self.pending_requests.is_empty() && self.is_out_of_sync() {
            return Err(End::Lost);
        }
        if self.lost {
            let is_open = |request: &Frame<'g>| self.pending_requests.holds(|open| open.is(request));
            if let Some(request) = self.dispatcher.lost(self.server, |request| !is_open(request)) {
                let unit = request.target();
                return Ok(Step::Send(request, unit));
            }
            self.lost = false;
        }
        let stays = self.settings.idle == Duration::from_ticks(0) || !self.pending_requests.is_empty();
        match self.dispatcher.next(self.connection) {
            Next::Serve(request, entry) => Ok(Step::Send(request, entry.unit)),
            Next::Wait(until) => Ok(Step::Wait(until)),
            Next::Empty if stays => Ok(Step::Wait(Instant::MAX)),
            Next::Empty => {
                let end = self.used + self.settings.idle;
                if now >= end { Err(End::Unused) } else { Ok(Step::Wait(end)) }
            }
        }
    }

    async fn send(&mut self, request: Frame<'g>, unit: u8, now: Instant) -> Result<(), End> {
        let broadcast = unit == BROADCAST && self.settings.framing == StreamFraming::Rtu;
        let mut id = 0;
        if !broadcast {
            id = match self.pending_requests.start(request.share(), unit, now) {
                Ok(id) => id,
                // Cannot happen: `room` was checked just now.
                Err(request) => {
                    self.dispatcher.failed(&request, 0);
                    return Ok(());
                }
            };
        }
        self.asked = true;
        self.dispatcher.sent(&request, if broadcast { BROADCAST } else { unit });
        let sent = self.write(id, unit, &request).await;
        self.active = now;
        if broadcast {
            self.dispatcher.done_without_response(&request);
            self.active += TURNAROUND;
        }
        sent?;
        self.used = now;
        Ok(())
    }

    /// How long nothing is sent after opening. With RTU over TCP, bytes received in that time cannot be matched to any request.
    fn settling(&self) -> Duration {
        let discards = self.settings.framing == StreamFraming::Rtu;
        let window = if discards { self.settings.late_window() } else { Duration::from_ticks(0) };
        window.max(self.settings.connect_delay)
    }

    /// Passes a frame to the capture.
    fn tap(&self, sent: bool, verdict: Event, bytes: &[u8]) {
        let kind = self.settings.framing.into();
        let tap = Tap { capture: self.dispatcher.gateway().capture(), port: self.dispatcher.id(), kind };
        tap.passed(|| tap.requester(), sent, verdict, bytes);
    }

    async fn write(&mut self, transaction: u16, unit: u8, request: &Frame<'g>) -> Result<(), End> {
        if self.settings.framing == StreamFraming::Rtu {
            // Whatever arrived before the request is not its response.
            self.judge_unsolicited();
        }
        let header = Header { transaction, unit: self.dispatcher.outside(unit) };
        let mut out = Pieces::new();
        loop {
            let begins = |frame: &[u8]| self.tap(true, Event::Request, frame);
            // Encoded again for each piece, so that the future need not hold the whole frame.
            self.dispatcher
                .with_request(request, |request| out.take(self.settings.framing, header, request, begins));
            // No flush: on embassy-net it would wait for the peer's acknowledgement.
            match within(self.settings.timeout, pin!(self.stream.write_all(out.piece()))).await {
                Some(Ok(())) if out.goes_on() => {}
                Some(Ok(())) => return Ok(()),
                _ => return Err(End::Lost),
            }
        }
    }
}
