//! One connection to an outside server while it is open: sends the dispatcher's requests and pairs the responses with them.
//!
//! By Modbus TCP several requests may be open at a time. A response is taken only when its transaction id belongs to an open
//! request and its unit, function, length and echoed fields are that request's; all others are dropped and counted, and
//! leave the response timers running. By RTU over TCP one request is open at a time, and its response is found by its length
//! and CRC, or by the pause behind it.

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

/// Pause after a broadcast by RTU over TCP: the turnaround delay of the line behind it (Serial Line 2.4.1).
const TURNAROUND: Duration = Duration::from_millis(100);
/// Bytes that may come between a request and the end of its response: a frame, and half of one of noise.
const INPUT_BYTES_MAX: usize = ADU_BYTES_MAX + ADU_BYTES_MAX / 2;
/// A connection that lived for so long without a request was in order, though the server has closed it.
const SETTLED: Duration = Duration::from_secs(1);

/// An open connection.
pub(crate) struct TcpConnection<'l, 'g, S> {
    dispatcher: &'l Dispatcher<'g>,
    settings: &'l TcpClientSettings,
    stream: S,
    pending_requests: PendingRequests<Frame<'g>>,
    /// Which of the port's connections it is, and to which server.
    connection: u8,
    server: usize,
    socket: &'l Socket,
    input: [u8; INPUT_BYTES_MAX],
    length: usize,
    opened: Instant,
    /// When something was sent or received last.
    active: Instant,
    /// When the last request was sent.
    used: Instant,
    /// When something was received last.
    heard: Instant,
    /// Whether a request was sent.
    asked: bool,
    /// Whether one was answered.
    proven: bool,
    /// Reads that the connection before took along, unanswered, may be left.
    lost: bool,
    /// The socket is needed elsewhere.
    leaving: bool,
}

/// What a connection does next.
enum Step<'g> {
    /// It sends this request to this unit.
    Send(Frame<'g>, u8),
    /// Nothing before this time, unless something happens.
    Wait(Instant),
}

/// Why a connection ends.
pub(crate) enum End {
    /// It is not needed now.
    Unused,
    /// The server has closed it, or it broke.
    Lost,
}

impl<'l, 'g, S: TcpStream> TcpConnection<'l, 'g, S> {
    /// A connection that has just been opened. `first` is the first transaction id.
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
            heard: now,
            asked: false,
            proven: false,
            lost: true,
            leaving: false,
        }
    }

    /// The connection has ended. Says whether the server is well as far as one can tell.
    ///
    /// What was open when the connection broke may have been carried out: it is answered 0Bh, but for reads that may be
    /// repeated. What has not been sent stays with the dispatcher. So do reads on a connection that has answered others: many a
    /// server closes after a response, before it sees what has been sent by then. The next connection begins with them.
    pub(crate) fn ended(&mut self, end: End) -> bool {
        let cut = !self.pending_requests.is_empty();
        let closed = self.proven && self.length == 0;
        while let Some(pending) = self.pending_requests.pop() {
            if closed && pending.request.pdu(pdu::is_read) && !is_responding(&pending.request) {
                self.dispatcher.port_state().stats.count(Event::Retry);
                // Without transaction ids it has to be proved first that nothing of it is to come.
                if self.settings.framing == StreamFraming::Rtu {
                    self.dispatcher.take_back(&pending.request);
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

    /// The stream, to be closed.
    pub(crate) fn into_stream(self) -> S {
        self.stream
    }

    /// Carries requests out until the connection ends.
    pub(crate) async fn serve(&mut self) -> Result<Infallible, End> {
        let socket = self.socket;
        loop {
            self.judge_pause();
            if self.expire() && self.is_astray() {
                return Err(End::Lost);
            }
            let due = loop {
                // What the server has closed by now would take the next request along.
                let space = self.input.get_mut(self.length..).filter(|space| !space.is_empty());
                let read = space.map_or(Poll::Pending, |space| poll_once(self.stream.read(space)));
                if let Poll::Ready(read) = read {
                    self.take(read.unwrap_or(0))?;
                    continue;
                }
                let now = Instant::now();
                match self.step(now)? {
                    Step::Send(request, unit) => self.send(request, unit, now).await?,
                    Step::Wait(due) => break due,
                }
            };
            if socket.busy(!self.pending_requests.is_empty() || self.begins()) {
                // It may be the one to go now.
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

    /// So many bytes have been read; none at the connection's end.
    fn take(&mut self, count: usize) -> Result<(), End> {
        if count == 0 { Err(End::Lost) } else { self.received(count) }
    }

    /// Whether nothing has been sent, but shall be: who has waited for the connection is served before it may go.
    fn begins(&self) -> bool {
        !self.asked && self.dispatcher.is_wanted(self.server)
    }

    /// What is to be done at `now`.
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
        if self.pending_requests.is_empty() && self.is_astray() {
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
                // There is room, it was looked for just now.
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
            self.dispatcher.done_silently(&request);
            self.active += TURNAROUND;
        }
        sent?;
        self.used = now;
        Ok(())
    }

    /// How long nothing is sent after the connection was opened. What comes meanwhile by RTU answers nobody knows what.
    fn settling(&self) -> Duration {
        let discards = self.settings.framing == StreamFraming::Rtu;
        let window = if discards { self.settings.late_window() } else { Duration::from_ticks(0) };
        window.max(self.settings.connect_delay)
    }

    /// Shows a frame to whoever follows.
    fn tap(&self, sent: bool, verdict: Event, bytes: &[u8]) {
        let kind = self.settings.framing.into();
        let tap = Tap { capture: self.dispatcher.gateway().capture(), port: self.dispatcher.id(), kind };
        tap.passed(|| tap.requester(), sent, verdict, bytes);
    }

    async fn write(&mut self, transaction: u16, unit: u8, request: &Frame<'g>) -> Result<(), End> {
        if self.settings.framing == StreamFraming::Rtu {
            // What came before the request is no response to it.
            self.judge_unawaited();
        }
        let header = Header { transaction, unit: self.dispatcher.outside(unit) };
        let mut out = Pieces::new();
        loop {
            let begins = |frame: &[u8]| self.tap(true, Event::Request, frame);
            // Looked up for each piece: it need not be kept while one is sent.
            self.dispatcher
                .with_request(request, |request| out.take(self.settings.framing, header, request, begins));
            // It is not flushed: on embassy-net that would wait for the peer's acknowledgement.
            match within(self.settings.timeout, pin!(self.stream.write_all(out.piece()))).await {
                Some(Ok(())) if out.goes_on() => {}
                Some(Ok(())) => return Ok(()),
                _ => return Err(End::Lost),
            }
        }
    }
}
