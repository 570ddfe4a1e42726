//! A TCP server: one of its connections, which serves one client after another, by Modbus TCP or RTU over TCP, with a
//! capture, or with the console by SSH.
//!
//! A listener has one connection per client that it allows, plus one that accepts newcomers and, when all are taken, decides
//! which client is displaced: the ordinary client idle longest. Requests are split off the stream, put into frames and sent to
//! the router; responses come in any order and carry their transaction ids. Two limits bound what a connection has in flight: the
//! `pipeline` setting (one more gets 06h), and frames (without a free one, the connection is not read until one of its own
//! returns).

use core::convert::Infallible;
use core::future::pending;
use core::net::SocketAddr;
use core::pin::pin;

use embassy_futures::select::{Either4, select4};
use embassy_time::{Duration, Instant, Timer};

use crate::capture::Tap;
use crate::frame::{Envelope, Origin, ReplyTo, Stage};
use crate::gateway::{Connection, Gateway, PortState};
use crate::hal::{OpenError, TcpHost, TcpStream};
use crate::modbus::tcp::{Header, Parsed};
use crate::modbus::{Exception, pdu};
use crate::port::server::listening;
use crate::port::stream::{Input, Pieces};
use crate::port::timer::{outlined, until, within};
use crate::settings::{
    Allowed, ClientRole, PortId, SSH, StreamFraming, TcpListen, TcpServerSettings, canonical,
};
use crate::stats::Event;

mod response;
// A separate file, not a `cfg!` branch: what an `async` function awaits stays in its future even behind a false constant.
#[cfg_attr(not(feature = "capture"), path = "tcp/no_export.rs")]
mod export;
#[cfg_attr(not(feature = "ssh"), path = "tcp/no_ssh.rs")]
mod ssh;
#[cfg_attr(not(feature = "tls"), path = "tcp/no_tls.rs")]
mod tls;
mod window;

use self::response::{Response, Taken, Waits, Worth};
use self::window::Window;

/// A client that does not accept a response for this long is disconnected.
const WRITE_PATIENCE: Duration = Duration::from_secs(10);

/// One connection of a TCP server.
pub(crate) struct Server<'s, 'g> {
    pub(crate) gateway: &'s Gateway<'g>,
    pub(crate) id: PortId,
    pub(crate) port_state: &'s PortState,
    pub(crate) settings: &'s Terms,
    pub(crate) connection: &'s Connection,
    pub(crate) index: usize,
}

/// The settings that a connection needs permanently. Address lists are looked up when a client connects: every connection holds a
/// copy of this.
#[derive(Clone, Copy)]
pub(crate) struct Terms {
    listen: TcpListen,
    framing: StreamFraming,
    idle: Duration,
    pipeline: u8,
    lifetime: Duration,
}

impl Terms {
    pub(crate) fn of(settings: &TcpServerSettings) -> Self {
        let TcpServerSettings { listen, framing, idle, pipeline, lifetime, .. } = *settings;
        Self { listen, framing, idle, pipeline, lifetime }
    }
}

/// The event to count when a connection ends.
type End = Event;

impl Server<'_, '_> {
    /// Serves one client after another, forever. Not an `async fn`, which would store its arguments twice per connection.
    pub(crate) fn run<H: TcpHost>(&self, host: &mut H) -> impl Future<Output = Infallible> {
        let mut window = Window::new(self.settings.pipeline);
        async move {
            loop {
                let (mut stream, peer) = match self.accept(host, &window).await {
                    Ok(accepted) => accepted,
                    Err(error) => {
                        listening::fails(self.port_state, "TCP", self.settings.listen.port, error);
                        Timer::after(listening::LISTEN_PAUSE).await;
                        continue;
                    }
                };
                self.port_state.stats.count(Event::Connected);
                window = Window::new(self.settings.pipeline);
                let role = self.secure(&mut stream, peer).await;
                let end = match role.and_then(|role| self.take_connection(peer, role)) {
                    Ok(_) if self.settings.framing == StreamFraming::Capture => {
                        outlined(pin!(self.export(&mut stream))).await
                    }
                    Ok(_) if SSH && self.settings.framing == StreamFraming::Ssh => {
                        outlined(pin!(self.converse(&mut stream, peer, &mut window))).await
                    }
                    Ok(origin) => {
                        let Err(end) = outlined(pin!(self.serve(&mut stream, origin, &mut window))).await;
                        end
                    }
                    Err(end) => end,
                };
                self.left();
                self.port_state.stats.count(end);
                stream.close().await;
                window.ended(&self.gateway.turns);
            }
        }
    }

    /// Accepts the next client. The listener stays open while the window delays newcomers.
    async fn accept<'h, H: TcpHost>(
        &self,
        host: &'h mut H,
        window: &Window,
    ) -> Result<(H::Stream<'h>, SocketAddr), OpenError> {
        let listen = &self.settings.listen;
        self.prepare(host)?;
        host.listen(listen)?;
        listening::listens(self.port_state, "TCP", listen.port, || {
            host.public_address(listen).filter(|_| self.serves_everybody())
        });
        until(window.turn).await;
        host.accept(listen).await
    }

    /// Whether no peer is refused.
    fn serves_everybody(&self) -> bool {
        let everybody = Allowed::everybody();
        self.gateway.settings(|settings| {
            settings.tcp_server(self.id).is_some_and(|server| server.allowed == everybody)
        })
    }

    /// Marks the connection as free, and drops responses that still arrive.
    pub(crate) fn left(&self) {
        self.connection.update(|connection| connection.peer = None);
        self.connection.responses.clear(self.gateway.pool());
    }

    /// Admits the newcomer, making room if necessary, or refuses it.
    fn take_connection(&self, peer: SocketAddr, role: ClientRole) -> Result<Origin, End> {
        let terms = self.gateway.settings(|settings| {
            let server = settings.tcp_server(self.id).filter(|server| server.allowed.admits(peer.ip()))?;
            let marked = server.reserved_for.iter().any(|prefix| prefix.contains(peer.ip()));
            Some((marked, usize::from(server.clients), usize::from(server.reserved), server.refuses))
        });
        let refused = |end| {
            listening::refuses(self.gateway, self.id, peer.ip(), end);
            Err(end)
        };
        let Some((marked, clients, reserved, refuses)) = terms else { return refused(End::Unwelcome) };
        let generation = self.connection.enter(peer, role, marked);
        let (mut connected, mut ordinary) = (0, 0);
        let mut idle: Option<(&Connection, Instant)> = None;
        for connection in self.gateway.connections() {
            let state = connection.state();
            if state.port != Some(self.id) || state.peer.is_none() || state.leaving {
                continue;
            }
            connected += 1;
            if state.marked {
                continue;
            }
            ordinary += 1;
            let may_go = state.open_requests == 0 && !core::ptr::eq(connection, self.connection);
            if may_go && idle.is_none_or(|(_, since)| state.last_request < since) {
                idle = Some((connection, state.last_request));
            }
        }
        let ordinary_max = clients.saturating_sub(reserved);
        if connected > clients || (!marked && ordinary > ordinary_max) {
            let Some((connection, _)) = idle.filter(|_| !refuses) else { return refused(End::Crowded) };
            listening::displaces(self.gateway, self.id, connection.displace(), peer.ip());
        }
        Ok(Origin { port: self.id, reply_to: ReplyTo::Connection(self.index as u16), generation })
    }

    /// Serves a client until it disconnects. Not an `async fn`, which would store its arguments twice per connection.
    fn serve<S: TcpStream>(
        &self,
        stream: &mut S,
        origin: Origin,
        window: &mut Window,
    ) -> impl Future<Output = Result<Infallible, End>> {
        let mut input = Input::new(self.settings.framing);
        async move {
            loop {
                let response = match self.take_requests(&mut input, origin, window)? {
                    Waits::ForReply(header, refusal) => Response::Refusal(header, refusal),
                    waits => {
                        let pause_end = match waits {
                            Waits::No => input.pause_end(),
                            Waits::ForTurn(turn) => turn,
                            _ => Instant::MAX,
                        };
                        let space = input.space();
                        let deaf = matches!(waits, Waits::ForFrame) || space.is_empty();
                        let responses = self.connection.responses.receive(self.gateway.pool());
                        // A client that is delayed is not idle.
                        let kept = matches!(waits, Waits::ForTurn(_));
                        let idle_until = if kept { Instant::MAX } else { self.idle_until() };
                        let wake = until(idle_until.min(pause_end));
                        // Responses first: a read that finds nothing takes its time, and wakes a board's network stack.
                        let event = {
                            // Pinned where it is made: with TLS it is too large to be moved.
                            let read =
                                pin!(async { if deaf { pending().await } else { stream.read(space).await } });
                            select4(responses, read, self.connection.leave.wait(), wake).await
                        };
                        match event {
                            Either4::First(frame) => Response::Response(frame),
                            Either4::Second(Ok(0) | Err(_)) => return Err(End::Left),
                            Either4::Second(Ok(count)) => {
                                input.grew(count);
                                continue;
                            }
                            Either4::Third(()) => return Err(End::Crowded),
                            Either4::Fourth(()) if idle_until <= Instant::now() => return Err(End::Stalled),
                            Either4::Fourth(()) => continue,
                        }
                    }
                };
                match response.worth() {
                    Worth::Refused => window.refused(&self.gateway.turns),
                    Worth::Crowded => window.crowded(&self.gateway.turns),
                    Worth::Answered => window.answered(),
                }
                self.write(stream, &response).await?;
            }
        }
    }

    /// Handles all complete requests; returns what the next one has to wait for.
    fn take_requests(&self, input: &mut Input, origin: Origin, window: &mut Window) -> Result<Waits, End> {
        loop {
            // RTU responses do not identify their request.
            if self.settings.framing == StreamFraming::Rtu && self.open_requests() > 0 {
                return Ok(Waits::ForTurn(Instant::MAX));
            }
            let turn = window.opens(self.open_requests());
            if turn > Instant::MIN && turn > Instant::now() {
                return Ok(Waits::ForTurn(turn));
            }
            let mut refusal = None;
            let (event, consumed) = match input.front() {
                Ok(Parsed::Incomplete) => {
                    if !input.is_empty() {
                        // The rest is on its way, so the client is not idle.
                        self.connection.update(|connection| connection.last_request = Instant::now());
                    }
                    return Ok(Waits::No);
                }
                Ok(Parsed::Skip { consumed }) => {
                    self.port_state.stats.count(input.skip_event());
                    window.refused(&self.gateway.turns);
                    (input.skip_event(), consumed)
                }
                Ok(Parsed::Frame { header, pdu, consumed }) => {
                    match self.take(origin, header, pdu) {
                        Taken::Sent => {}
                        Taken::Refused(exception) => {
                            let response = exception.response(pdu.first().copied().unwrap_or(0));
                            refusal = Some(Waits::ForReply(header, response));
                        }
                        Taken::Starved => {
                            self.port_state.stats.count(Event::BackPressure);
                            return Ok(Waits::ForFrame);
                        }
                    }
                    (Event::Request, consumed)
                }
                Err(_) => return Err(End::Malformed),
            };
            self.tap(false, event, input.first(consumed));
            input.consume(consumed);
            if let Some(refusal) = refusal {
                return Ok(refusal);
            }
        }
    }

    /// Sends a request to the router, or returns why not.
    fn take(&self, origin: Origin, header: Header, request: &[u8]) -> Taken {
        if let Err(exception) = pdu::check_request(request) {
            self.port_state.stats.count(Event::Refused);
            self.port_state.stats.note_refused(request, exception);
            return Taken::Refused(exception);
        }
        if self.open_requests() >= self.settings.pipeline {
            self.port_state.stats.count(Event::QueueFull);
            return Taken::Refused(Exception::BUSY);
        }
        let received = Instant::now();
        let deadline = received + self.settings.lifetime;
        let envelope = Envelope {
            transaction: header.transaction,
            peer: self.peer().map(|peer| canonical(peer.ip())),
            ..Envelope::request(origin, header.unit, received, deadline)
        };
        // Fits: the parser limits the length of a PDU.
        let Some(frame) = self.gateway.pool().fill(self.index, request, envelope) else {
            return Taken::Starved;
        };
        self.port_state.stats.count(Event::Request);
        self.connection.update(|connection| {
            connection.last_request = received;
            connection.open_requests += 1;
            connection.requests = connection.requests.wrapping_add(1);
        });
        self.gateway.inbox.send(frame);
        Taken::Sent
    }

    /// Writes a response. No flush: on embassy-net it would wait for the peer's acknowledgement.
    async fn write<S: TcpStream>(&self, stream: &mut S, response: &Response<'_>) -> Result<(), End> {
        let mut out = Pieces::new();
        loop {
            self.encode(response, &mut out);
            if out.piece().is_empty() {
                return Ok(());
            }
            match within(WRITE_PATIENCE, pin!(stream.write_all(out.piece()))).await {
                Some(Ok(())) if out.goes_on() => {}
                Some(Ok(())) => return Ok(()),
                Some(Err(_)) => return Err(End::Left),
                None => return Err(End::Stalled),
            }
        }
    }

    /// Encodes the next piece of the response into `out`; a frame that returned without a response is only accounted for.
    fn encode(&self, response: &Response<'_>, out: &mut Pieces) {
        let frame = match response {
            Response::Refusal(header, response) => return self.put(*header, response, out),
            Response::Response(frame) => frame,
        };
        let Envelope { stage, cause, transaction, unit, .. } = frame.envelope();
        if out.is_new() {
            self.connection
                .update(|connection| connection.open_requests = connection.open_requests.saturating_sub(1));
        }
        if stage == Stage::Silence {
            return;
        }
        frame.pdu(|response| {
            if out.is_new() {
                self.port_state.stats.answered(response, cause);
            }
            self.put(Header { transaction, unit }, response, out);
        });
    }

    fn put(&self, header: Header, response: &[u8], out: &mut Pieces) {
        out.take(self.settings.framing, header, response, |frame| self.tap(true, Event::Response, frame));
    }

    /// Passes a frame from or to the client to the capture.
    fn tap(&self, sent: bool, verdict: Event, bytes: &[u8]) {
        let tap = Tap { capture: self.gateway.capture(), port: self.id, kind: self.settings.framing.into() };
        let requester = || self.peer().map_or(0, |peer| peer.port());
        tap.passed(requester, sent, verdict, bytes);
    }

    /// When the client's idle time ends; never while it waits for a response.
    fn idle_until(&self) -> Instant {
        let (open, last_request) =
            self.connection.update(|connection| (connection.open_requests, connection.last_request));
        let never = self.settings.idle == Duration::from_ticks(0) || open > 0;
        if never { Instant::MAX } else { last_request + self.settings.idle }
    }

    /// The client.
    fn peer(&self) -> Option<SocketAddr> {
        self.connection.update(|connection| connection.peer)
    }

    /// Requests of this connection without a response so far.
    fn open_requests(&self) -> u8 {
        self.connection.update(|connection| connection.open_requests)
    }
}
