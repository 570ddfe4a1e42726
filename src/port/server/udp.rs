//! A Modbus UDP server: each datagram is one Modbus TCP frame, and its response goes back to the sender.
//!
//! Without connections, open requests are kept in a table, bounded per peer and in total; one more gets 06h. A datagram
//! duplicated by the network, or repeated by an impatient client, is not executed again while the first is open. A datagram that
//! is not exactly one frame is dropped.

use core::cell::RefCell;
use core::net::SocketAddr;

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use heapless::Vec;

use crate::capture::{FrameKind, Tap};
use crate::frame::{Envelope, Frame, Origin, ReplyTo, Stage};
use crate::gateway::{Gateway, PortState, Status};
use crate::hal::{SocketLost, UdpHost, UdpSocket};
use crate::modbus::tcp::{self, ADU_BYTES_MAX, Header, Parsed};
use crate::modbus::{Exception, pdu};
use crate::port::server::listening;
use crate::settings::{PortId, UDP_REQUESTS_MAX, UdpServerSettings, canonical};
use crate::stats::Event;

/// Pause after a failure of the socket.
const BIND_PAUSE: Duration = Duration::from_secs(1);
/// One byte more than a frame, to detect datagrams that are too long.
const DATAGRAM_BYTES_MAX: usize = ADU_BYTES_MAX + 1;

/// The buffer for a response.
type Out = [u8; ADU_BYTES_MAX];
/// Its destination and length.
type Response = (SocketAddr, usize);

/// A UDP server.
pub(crate) struct Server<'s, 'g> {
    gateway: &'s Gateway<'g>,
    port_state: &'s PortState,
    id: PortId,
    settings: &'s UdpServerSettings,
    open: RefCell<Vec<Open, UDP_REQUESTS_MAX>>,
}

/// An open request.
#[derive(Clone, Copy)]
struct Open {
    peer: SocketAddr,
    header: Header,
    /// The transaction id inside the gateway, since ids of different peers may be equal.
    number: u16,
}

impl<'s, 'g> Server<'s, 'g> {
    /// A server without open requests.
    pub(crate) fn new(
        gateway: &'s Gateway<'g>,
        port_state: &'s PortState,
        id: PortId,
        settings: &'s UdpServerSettings,
    ) -> Self {
        Self { gateway, port_state, id, settings, open: RefCell::new(Vec::new()) }
    }

    /// Keeps the socket open and serves it, forever.
    pub(crate) async fn run<H: UdpHost>(&self, host: &mut H) -> ! {
        loop {
            let port = self.settings.listen.port;
            match host.bind(&self.settings.listen).await {
                Ok(mut socket) => {
                    listening::listens(self.port_state, "UDP", port, || None);
                    let SocketLost = self.serve(&mut socket).await;
                    self.port_state.stats.count(Event::LineLost);
                    self.port_state.set_status(Status::Lost);
                }
                Err(error) => listening::fails(self.port_state, "UDP", port, error),
            }
            Timer::after(BIND_PAUSE).await;
        }
    }

    /// Drops responses that arrive from now on, as the socket is closed.
    pub(crate) fn close(&self) {
        self.port_state.renew();
        self.port_state.queue.clear(self.gateway.pool());
    }

    async fn serve<S: UdpSocket>(&self, socket: &mut S) -> SocketLost {
        let mut datagram = [0; DATAGRAM_BYTES_MAX];
        let mut out = [0; ADU_BYTES_MAX];
        let mut number = 0_u16;
        loop {
            let responses = self.port_state.queue.receive(self.gateway.pool());
            let response = match select(responses, socket.receive(&mut datagram)).await {
                Either::First(frame) => self.respond(&frame, &mut out),
                Either::Second(Ok((length, peer))) => {
                    number = number.wrapping_add(1);
                    let received = datagram.get(..length).unwrap_or(&[]);
                    self.take(received, peer, number, &mut out)
                }
                Either::Second(Err(lost)) => return lost,
            };
            let Some((peer, length)) = response else { continue };
            if let Err(lost) = socket.send(out.get(..length).unwrap_or(&[]), peer).await {
                return lost;
            }
        }
    }

    /// Handles a datagram: sends its request to the router, or writes an exception into `out`.
    fn take(&self, datagram: &[u8], peer: SocketAddr, number: u16, out: &mut Out) -> Option<Response> {
        let stats = &self.port_state.stats;
        if !self.settings.allowed.admits(peer.ip()) {
            stats.count(Event::Unwelcome);
            listening::refuses(self.gateway, self.id, peer.ip(), Event::Unwelcome);
            return None;
        }
        let (header, request) = match tcp::parse(datagram) {
            Ok(Parsed::Frame { header, pdu, consumed }) if consumed == datagram.len() => (header, pdu),
            _ => {
                stats.count(Event::Malformed);
                return None;
            }
        };
        self.tap(peer, false, Event::Request, datagram);
        let (event, exception) = match self.ask(header, request, peer, number) {
            Ok(()) => return None,
            Err(refusal) => refusal,
        };
        stats.count(event);
        let response = exception?.response(request.first().copied().unwrap_or(0));
        self.response(peer, header, &response, out)
    }

    /// Sends a request to the router, or returns the event to count and the exception to respond with, if any.
    fn ask(
        &self,
        header: Header,
        request: &[u8],
        peer: SocketAddr,
        number: u16,
    ) -> Result<(), (Event, Option<Exception>)> {
        let mut open = self.open.borrow_mut();
        let of_peer = || open.iter().filter(|open| open.peer == peer);
        if of_peer().any(|open| open.header == header) {
            return Err((Event::Duplicate, None));
        }
        if let Err(exception) = pdu::check_request(request) {
            self.port_state.stats.note_refused(request, exception);
            return Err((Event::Refused, Some(exception)));
        }
        let own = usize::from(self.settings.pipeline);
        if of_peer().count() >= own || open.len() >= usize::from(self.settings.requests) {
            return Err((Event::QueueFull, Some(Exception::BUSY)));
        }
        let envelope = self.envelope(header.unit, peer, number);
        // Fits: the parser limits the length of a PDU.
        let Some(frame) = self.gateway.fill_for_port(self.id, request, envelope) else {
            return Err((Event::BackPressure, Some(Exception::BUSY)));
        };
        self.port_state.stats.count(Event::Request);
        // Within the capacity: `requests` is at most the size of the table.
        let _ = open.push(Open { peer, header, number });
        self.gateway.inbox.send(frame);
        Ok(())
    }

    /// Passes a frame from or to `peer` to the capture.
    fn tap(&self, peer: SocketAddr, sent: bool, verdict: Event, bytes: &[u8]) {
        let tap = Tap { capture: self.gateway.capture(), port: self.id, kind: FrameKind::Udp };
        tap.passed(|| peer.port(), sent, verdict, bytes);
    }

    fn envelope(&self, unit: u8, peer: SocketAddr, number: u16) -> Envelope {
        let received = Instant::now();
        let origin =
            Origin { port: self.id, reply_to: ReplyTo::Port, generation: self.port_state.generation() };
        Envelope {
            transaction: number,
            peer: Some(canonical(peer.ip())),
            ..Envelope::request(origin, unit, received, received + self.settings.lifetime)
        }
    }

    /// Writes the response in `frame` into `out`; `None` if the frame returned without one.
    fn respond(&self, frame: &Frame<'_>, out: &mut Out) -> Option<Response> {
        let envelope = frame.envelope();
        let mut open = self.open.borrow_mut();
        let at = open.iter().position(|open| open.number == envelope.transaction)?;
        let Open { peer, header, .. } = open.swap_remove(at);
        if envelope.stage == Stage::Silence {
            return None;
        }
        let response = frame.content();
        self.port_state.stats.answered(&response, envelope.cause);
        self.response(peer, header, &response, out)
    }

    /// Writes `response` into `out`.
    fn response(&self, peer: SocketAddr, header: Header, response: &[u8], out: &mut Out) -> Option<Response> {
        let datagram = tcp::encode(header, response, out).ok()?;
        self.tap(peer, true, Event::Response, datagram);
        Some((peer, datagram.len()))
    }
}
