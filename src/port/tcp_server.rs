//! A TCP server: one seat's part of it, which serves one client after the other, by Modbus TCP or RTU over TCP, or with a capture.
//!
//! Each of the listener's clients has a seat; one seat more is always there to accept a newcomer and to decide who goes
//! when all places are taken: the ordinary client that has been idle longest. Requests are cut out of the stream, put
//! into frames and sent to the router; answers come in any order and carry their transaction id. What a connection
//! has open is bounded twice: by the `pipeline` setting (one more is answered 06h) and by frames (none free: the
//! connection is not read until one of its own comes home).

use core::future::pending;
use core::net::SocketAddr;
use core::pin::pin;

use embassy_futures::select::{Either4, select4};
use embassy_time::{Duration, Instant, Timer};

use crate::capture::Tap;
use crate::config::{PortId, StreamFraming, TcpListen, TcpServerSettings};
use crate::frame::{Cause, Envelope, Frame, Origin, Stage, Way};
use crate::gateway::{Gateway, PortPlace, Seat, SeatState, Status};
use crate::hal::{TcpHost, TcpStream};
use crate::modbus::Exception;
use crate::modbus::pdu::{self, EXCEPTION_BIT};
use crate::modbus::tcp::{ADU_BYTES_MAX, Header, Parsed};
use crate::port::moment::{until, within};
use crate::port::stream::{Input, Pieces, encode};
use crate::stats::{Event, LastError};

// One of two: what an `async` function awaits stays in it, also behind a constant.
#[cfg_attr(not(feature = "capture"), path = "tcp_server/no_export.rs")]
mod export;

/// A client that does not take an answer for so long is closed.
const WRITE_PATIENCE: Duration = Duration::from_secs(10);
/// Pause after the listener failed.
const LISTEN_PAUSE: Duration = Duration::from_secs(1);

/// One seat of a TCP server.
pub(crate) struct Server<'s, 'g> {
    pub(crate) gateway: &'s Gateway<'g>,
    pub(crate) id: PortId,
    pub(crate) place: &'s PortPlace,
    pub(crate) settings: &'s Terms,
    pub(crate) seat: &'s Seat,
    pub(crate) index: usize,
}

/// What a seat keeps of its server's settings. The lists of addresses it looks up when a client comes: each seat has a copy of
/// this for ever.
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

/// Why a connection ends.
enum End {
    /// The client closed it, or it broke.
    Client,
    /// The client was idle too long or does not read.
    Stalled,
    /// What came is no Modbus TCP.
    Malformed,
    /// Its place was needed.
    Crowded,
    /// Its address is not allowed.
    Unwelcome,
}

impl Server<'_, '_> {
    /// Serves one client after the other, for ever.
    pub(crate) async fn run<H: TcpHost>(&self, host: &mut H) {
        loop {
            if let Err(error) = self.serve_next(host).await {
                self.place.stats.note(LastError::Port);
                if self.place.set_status(Status::Failed(error)) {
                    log_warn!("TCP port {} cannot be opened: {}", self.settings.listen.port, error);
                }
                Timer::after(LISTEN_PAUSE).await;
            }
        }
    }

    async fn serve_next<H: TcpHost>(&self, host: &mut H) -> Result<(), crate::hal::OpenError> {
        host.listen(&self.settings.listen)?;
        if self.place.set_status(Status::Open) {
            self.place.stats.note(LastError::None);
            log_info!("listening on TCP port {}", self.settings.listen.port);
        }
        let (mut stream, peer) = host.accept(&self.settings.listen).await?;
        self.place.stats.count(Event::Connected);
        let end = if self.all_settings(|settings| settings.allowed.admits(peer.ip())) == Some(true) {
            match self.seat_down(peer) {
                Some(_) if self.settings.framing == StreamFraming::Capture => self.export(&mut stream).await,
                Some(origin) => self.serve(&mut stream, origin).await,
                None => End::Crowded,
            }
        } else {
            End::Unwelcome
        };
        self.left();
        self.place.stats.count(match end {
            End::Client => Event::Left,
            End::Stalled => Event::Stalled,
            End::Malformed => Event::Malformed,
            End::Crowded => Event::Crowded,
            End::Unwelcome => Event::Unwelcome,
        });
        stream.close().await;
        Ok(())
    }

    /// What `of` takes from the server's settings; none when it is no server any more.
    fn all_settings<R>(&self, of: impl FnOnce(&TcpServerSettings) -> R) -> Option<R> {
        self.gateway.settings(|settings| settings.tcp_server(self.id).map(of))
    }

    /// The seat is empty: answers that still come find nobody.
    pub(crate) fn left(&self) {
        self.seat.update(|seat| seat.peer = None);
        while self.seat.answers.try_receive(self.gateway.pool()).is_some() {}
    }

    /// Takes the newcomer in and sees that there is room, or refuses it.
    fn seat_down(&self, peer: SocketAddr) -> Option<Origin> {
        let now = Instant::now();
        self.seat.leave.reset();
        let (marked, clients, reserved) = self.all_settings(|settings| {
            let marked = settings.reserved_for.iter().any(|prefix| prefix.contains(peer.ip()));
            (marked, usize::from(settings.clients), usize::from(settings.reserved))
        })?;
        let own = self.seat.update(|seat| {
            let generation = seat.generation.wrapping_add(1);
            let (port, peer) = (seat.port, Some(peer));
            *seat = SeatState {
                port,
                peer,
                marked,
                generation,
                since: now,
                last_request: now,
                ..SeatState::EMPTY
            };
            *seat
        });
        let seated = || {
            let of_port =
                |seat: &SeatState| seat.port == Some(self.id) && seat.peer.is_some() && !seat.leaving;
            self.gateway
                .seats()
                .iter()
                .map(|seat| (seat, seat.state()))
                .filter(move |(_, seat)| of_port(seat))
        };
        let ordinary_max = clients.saturating_sub(reserved);
        let ordinary = seated().filter(|(_, seat)| !seat.marked).count();
        if seated().count() > clients || (!own.marked && ordinary > ordinary_max) {
            let idle = seated().filter(|(seat, state)| {
                !core::ptr::eq(*seat, self.seat) && !state.marked && state.open_requests == 0
            });
            let (seat, _) = idle.min_by_key(|(_, state)| state.last_request)?;
            seat.update(|seat| seat.leaving = true);
            seat.leave.signal(());
        }
        Some(Origin { port: self.id, way: Way::Seat(self.index as u16), generation: own.generation })
    }

    async fn serve<S: TcpStream>(&self, stream: &mut S, origin: Origin) -> End {
        let mut input = Input::new(self.settings.framing);
        loop {
            let waits = match self.take_requests(stream, &mut input, origin).await {
                Ok(waits) => waits,
                Err(end) => return end,
            };
            let pause_end = if waits == Waits::No { input.pause_end() } else { Instant::MAX };
            let space = input.space();
            let deaf = waits == Waits::ForFrame || space.is_empty();
            let read = async { if deaf { pending().await } else { stream.read(space).await } };
            let answers = self.seat.answers.receive(self.gateway.pool());
            let idle_until = self.idle_until();
            let wake = until(idle_until.min(pause_end));
            match select4(read, answers, self.seat.leave.wait(), wake).await {
                Either4::First(Ok(0) | Err(_)) => return End::Client,
                Either4::First(Ok(count)) => input.grew(count),
                Either4::Second(frame) => {
                    if let Err(end) = self.give(stream, frame).await {
                        return end;
                    }
                }
                Either4::Third(()) => return End::Crowded,
                Either4::Fourth(()) if idle_until <= Instant::now() => return End::Stalled,
                Either4::Fourth(()) => {}
            }
        }
    }

    /// Takes the requests that are whole, and says whether the next one has to wait.
    async fn take_requests<S: TcpStream>(
        &self,
        stream: &mut S,
        input: &mut Input,
        origin: Origin,
    ) -> Result<Waits, End> {
        loop {
            // RTU answers do not say which request they belong to.
            if self.settings.framing == StreamFraming::Rtu && self.open_requests() > 0 {
                return Ok(Waits::ForAnswer);
            }
            let consumed = match input.front() {
                Ok(Parsed::Incomplete) => return Ok(Waits::No),
                Ok(Parsed::Skip { consumed }) => {
                    self.place.stats.count(input.skip_event());
                    self.tap(false, input.skip_event(), input.first(consumed));
                    consumed
                }
                Ok(Parsed::Frame { header, pdu, consumed }) => match self.take(origin, header, pdu) {
                    Taken::Sent => {
                        self.tap(false, Event::Request, input.first(consumed));
                        consumed
                    }
                    Taken::Refused(exception) => {
                        let answer = exception.response(pdu.first().copied().unwrap_or(0));
                        self.tap(false, Event::Request, input.first(consumed));
                        let mut out = Pieces::new();
                        self.frame(header, &answer, &mut out);
                        self.write(stream, out.piece()).await?;
                        consumed
                    }
                    Taken::Starved => {
                        self.place.stats.count(Event::BackPressure);
                        return Ok(Waits::ForFrame);
                    }
                },
                Err(_) => return Err(End::Malformed),
            };
            input.consume(consumed);
        }
    }

    /// Sends a request to the router, or says why not.
    fn take(&self, origin: Origin, header: Header, request: &[u8]) -> Taken {
        if let Err(exception) = pdu::check_request(request) {
            self.place.stats.count(Event::Refused);
            self.place.stats.note_refused(request, exception);
            return Taken::Refused(exception);
        }
        if self.open_requests() >= self.settings.pipeline {
            self.place.stats.count(Event::QueueFull);
            return Taken::Refused(Exception::BUSY);
        }
        let received = Instant::now();
        let deadline = received + self.settings.lifetime;
        let envelope = Envelope {
            transaction: header.transaction,
            peer: self.peer().map(|peer| peer.ip().to_canonical()),
            ..Envelope::request(origin, header.unit, received, deadline)
        };
        // The parser gives no longer PDU than fits.
        let Some(frame) = self.gateway.pool().fill(self.index, request, envelope) else {
            return Taken::Starved;
        };
        self.place.stats.count(Event::Request);
        self.seat.update(|seat| {
            seat.last_request = received;
            seat.open_requests += 1;
            seat.requests = seat.requests.wrapping_add(1);
        });
        self.gateway.inbox.send(frame);
        Taken::Sent
    }

    /// Gives an answer to the client; a frame that came home without one is only counted off.
    async fn give<S: TcpStream>(&self, stream: &mut S, frame: Frame<'_>) -> Result<(), End> {
        self.seat.update(|seat| seat.open_requests = seat.open_requests.saturating_sub(1));
        let (stage, cause, header) = frame.look(|envelope| {
            let header = Header { transaction: envelope.transaction, unit: envelope.unit };
            (envelope.stage, envelope.cause, header)
        });
        if stage == Stage::Silence {
            return Ok(());
        }
        frame.pdu(|answer| self.count_answer(answer, cause));
        let mut out = Pieces::new();
        loop {
            frame.pdu(|answer| self.frame(header, answer, &mut out));
            self.write(stream, out.piece()).await?;
            if !out.goes_on() {
                return Ok(());
            }
        }
    }

    /// Puts the next piece of an answer's frame into `out`.
    fn frame(&self, header: Header, answer: &[u8], out: &mut Pieces) {
        let mut frame = [0; ADU_BYTES_MAX];
        let frame = encode(self.settings.framing, header, answer, &mut frame).unwrap_or(&[]);
        if out.is_new() {
            self.tap(true, Event::Answer, frame);
        }
        out.take(frame);
    }

    fn count_answer(&self, answer: &[u8], cause: Cause) {
        self.place.stats.count(Event::Answer);
        if let [function, code] = *answer
            && function & EXCEPTION_BIT != 0
        {
            self.place.stats.count(Event::Exception);
            self.place.stats.note_exception(Exception(code), cause);
        }
    }

    /// Writes a piece of an answer's frame. It is not flushed: on embassy-net that would wait for the peer's acknowledgement.
    async fn write<S: TcpStream>(&self, stream: &mut S, piece: &[u8]) -> Result<(), End> {
        match within(WRITE_PATIENCE, pin!(stream.write_all(piece))).await {
            Some(Ok(())) => Ok(()),
            Some(Err(_)) => Err(End::Client),
            None => Err(End::Stalled),
        }
    }

    /// Shows a frame from or to the client to whoever follows.
    fn tap(&self, sent: bool, verdict: Event, bytes: &[u8]) {
        let tap = Tap { capture: self.gateway.capture(), port: self.id, kind: self.settings.framing.into() };
        let asker = || self.peer().map_or(0, |peer| peer.port());
        tap.passed(asker, sent, verdict, bytes);
    }

    /// When the client will have been idle too long; never while it waits for an answer.
    fn idle_until(&self) -> Instant {
        let (open, last_request) = self.seat.update(|seat| (seat.open_requests, seat.last_request));
        let never = self.settings.idle == Duration::from_ticks(0) || open > 0;
        if never { Instant::MAX } else { last_request + self.settings.idle }
    }

    /// The client.
    fn peer(&self) -> Option<SocketAddr> {
        self.seat.update(|seat| seat.peer)
    }

    /// Requests of this connection that are not answered yet.
    fn open_requests(&self) -> u8 {
        self.seat.update(|seat| seat.open_requests)
    }
}

/// Whether the next request of a connection has to wait.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Waits {
    /// It can be taken as soon as it has come.
    No,
    /// The one before it has no answer yet.
    ForAnswer,
    /// There is no frame for it now.
    ForFrame,
}

/// What became of a request.
enum Taken {
    /// The router has it.
    Sent,
    /// It is answered here.
    Refused(Exception),
    /// There is no frame for it now.
    Starved,
}
