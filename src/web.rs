//! The web interface: HTTP with JSON at `/api/v1`, on the port that the settings name; docs/openapi.yaml describes it.
//!
//! A request passes `guard` (its host and origin), `api` (its path in `routes`, its user and the user's role), and one of the `calls`,
//! which do what the console's commands do, by the same tables, candidate and direct requests. They fill in the `response`,
//! which is sent row by row. The framing is picoserve's, over the board's streams.

// An error in a line has the line and its word: there is no heap.
#![allow(clippy::result_large_err)]

mod api;
mod calls;
mod candidate;
mod commands;
// Replaced by a stub in images without capture.
#[cfg_attr(not(feature = "capture"), path = "web/no_frames.rs")]
mod frames;
mod guard;
mod headers;
mod job;
mod json;
mod lines;
mod members;
mod metrics;
mod response;
mod routes;
// Replaced by a stub in images without the page.
#[cfg_attr(not(feature = "page"), path = "web/no_page.rs")]
mod page;
mod piece;
mod reader;
mod session;
mod settings;
mod status;
#[cfg(test)]
mod tests;
mod transport;
mod untaken;
mod update;
mod versions;

use core::future::pending;
use core::net::SocketAddr;

use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_sync::mutex::Mutex;
use embassy_time::{Duration, Instant, Timer};
use picoserve::{Config, Router, Server, Timeouts, time};

use self::api::{Api, Terms};
use self::transport::{Clock, Halves, Life, REQUEST_BYTES_MAX};
use crate::gateway::{Gateway, PortState};
use crate::hal::{OpenError, OpenErrorKind, Store, System, TcpHost, TcpStream, Update};
use crate::port::server::handshake::handshake;
use crate::port::server::listening;
use crate::settings::{Allowed, HttpSettings, PortId, PortKind, Settings, TcpListen, canonical};
use crate::stats::Event;

/// Pause after a failed accept.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);
/// A connection is closed at this age: the longest response time-out, and a margin. Longer work extends it.
const AGE_MAX: Duration = Duration::from_secs(140);

/// A request must begin, and must have arrived, within these times; a piece of the response must be taken within the last one.
const TIMEOUTS: Timeouts = Timeouts {
    start_read_request: time::Duration::from_secs(3),
    persistent_start_read_request: time::Duration::from_secs(3),
    read_request: time::Duration::from_secs(5),
    write: time::Duration::from_secs(5),
};
/// One request per connection, so that no client blocks others.
const CONFIG: Config = Config::new(TIMEOUTS).close_connection_after_response();

/// No user can log in yet.
const OFF: OpenError = OpenError::new(
    OpenErrorKind::Denied,
    "until somebody can log in: user NAME role engineer, password NAME",
);

/// The port of the web interface.
#[derive(PartialEq, Eq)]
struct Port {
    id: PortId,
    listen: TcpListen,
    /// A user can log in.
    is_on: bool,
}

impl Port {
    fn of(settings: &Settings) -> Option<Self> {
        let is_on = settings.can_log_in();
        settings.ports.iter().enumerate().find_map(|(at, port)| match &port.as_ref()?.kind {
            PortKind::Http(server) => Some(Self { id: PortId(at as u8), listen: server.listen, is_on }),
            _ => None,
        })
    }
}

/// The settings of the port.
fn server(settings: &Settings, id: PortId) -> Option<&HttpSettings> {
    match &settings.port(id)?.kind {
        PortKind::Http(server) => Some(server),
        _ => None,
    }
}

/// Serves one connection after another, forever, as task number `nth`: a board runs up to 8, which are as many connections at a time.
pub async fn run<H: TcpHost, S: Store, U: Update, Y: System>(
    gateway: &Gateway<'_>,
    nth: usize,
    host: &mut H,
    (store, update): (&mut S, &mut U),
    system: &Y,
) {
    let Some(changed) = gateway.web.changed(nth) else { return pending().await };
    loop {
        let port = gateway.settings(Port::of);
        let at = port.and_then(|port| Some((gateway.ports().get(port.id.index())?, port)));
        let Some((port_state, port)) = at else {
            changed.wait().await;
            continue;
        };
        if !port.is_on {
            listening::fails(port_state, "TCP", port.listen.port, OFF);
            changed.wait().await;
            continue;
        }
        let moved = async {
            while gateway.settings(Port::of).as_ref() == Some(&port) {
                // The port was restarted, but not its listener.
                listening::listens(port_state, "TCP", port.listen.port, || None);
                changed.wait().await;
            }
        };
        let marked = async {
            loop {
                gateway.web.hour.mark(Instant::now(), gateway.port_states());
                Timer::at(gateway.web.hour.due()).await;
            }
        };
        match select(select(moved, marked), accept(gateway, port_state, &port, host)).await {
            // All tasks release the listener before a new one is opened.
            Either::First(_) => yield_now().await,
            Either::Second(Ok((stream, peer))) => {
                serve(gateway, port.id, (stream, peer), (&mut *store, &mut *update), system).await;
            }
            Either::Second(Err(error)) => {
                listening::fails(port_state, "TCP", port.listen.port, error);
                select(changed.wait(), Timer::after(ACCEPT_PAUSE)).await;
            }
        }
    }
}

/// Accepts the next client.
async fn accept<'h, H: TcpHost>(
    gateway: &Gateway<'_>,
    port_state: &PortState,
    port: &Port,
    host: &'h mut H,
) -> Result<(H::Stream<'h>, SocketAddr), OpenError> {
    if gateway.settings(|settings| server(settings, port.id).is_some_and(HttpSettings::is_encrypted)) {
        host.prepare_tls(port.id)?;
    }
    host.listen(&port.listen)?;
    listening::listens(port_state, "TCP", port.listen.port, || {
        let everybody = Allowed::everybody();
        let is_open =
            gateway.settings(|settings| server(settings, port.id).map(|server| server.allowed == everybody));
        host.public_address(&port.listen).filter(|_| is_open == Some(true))
    });
    host.accept(&port.listen).await
}

/// Serves the client at `peer`.
async fn serve<S: Store, U: Update, Y: System>(
    gateway: &Gateway<'_>,
    id: PortId,
    (mut stream, peer): (impl TcpStream, SocketAddr),
    (store, update): (&mut S, &mut U),
    system: &Y,
) {
    let life = Life::new(AGE_MAX);
    let peer = canonical(peer.ip());
    let terms = gateway.settings(|settings| {
        server(settings, id)
            .filter(|server| server.allowed.admits(peer))
            .map(|server| Terms::of(server, peer))
    });
    if let Some(terms) = terms {
        if terms.encrypted && handshake(gateway, id, &mut stream, peer).await.is_err() {
            return stream.close().await;
        }
        let mut buffer = [0; REQUEST_BYTES_MAX];
        let app = Router::from_service(Api {
            gateway,
            store: Mutex::new(store),
            update: Mutex::new(update),
            system,
            port: id,
            peer,
            terms,
            life: &life,
        });
        let server = Server::custom(&app, Clock(&life), &CONFIG, &mut buffer);
        // An error ends the connection.
        select(server.serve(Halves::new(&mut stream, &life)), life.is_over()).await;
    } else {
        listening::refuses(gateway, id, peer, Event::Unwelcome);
    }
    stream.close().await;
    if life.restarts.get() {
        system.reboot();
    }
}
