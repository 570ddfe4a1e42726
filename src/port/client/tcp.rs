//! A client-side TCP port: the gateway is a client of outside servers, by Modbus TCP or RTU over TCP.
//!
//! A connection is opened for the first request to its server and closed after the idle time without requests; with `idle 0` it
//! is opened at once and kept. While it is open, [`TcpConnection`] serves the requests. A port with several servers has at most
//! `sockets` connections at a time; [`servers`](crate::port::client::servers) decides to which.
//! Requests for an unreachable server get 0Ah at once: there is no path, so nothing was sent and nothing happened at the device.
//! 0Bh means the opposite: the request was sent, or may have been, and no valid response arrived. The gateway retries to connect in
//! the background at growing intervals, so only the first request waits for the network's time-out, and requests whose sender has
//! its own back-off, each of which triggers an attempt.

use core::pin::pin;

use embassy_futures::join::join_array;
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, with_deadline, with_timeout};

use crate::gateway::Status;
use crate::gateway::socket::{self, Need, Socket};
use crate::hal::{OpenError, OpenErrorKind, TcpConnect, TcpStream};
use crate::port::client::connection::TcpConnection;
use crate::port::client::dispatcher::Dispatcher;
use crate::port::client::servers::CONNECTIONS_MAX;
use crate::port::timer::outlined;
use crate::settings::TcpClientSettings;
use crate::stats::Event;

// A separate file, as for servers: what an `async` function awaits stays in its future.
#[cfg_attr(not(feature = "tls"), path = "tcp/no_tls.rs")]
mod tls;

/// Pause before a socket is requested again: not only client ports use sockets.
const SOCKET_PAUSE: Duration = Duration::from_millis(50);
/// Distance between the first transaction ids of successive connections, so that a server that mixes them up is noticed.
pub(crate) const ID_STRIDE: u16 = 4_099;

const CLOSED_AT_ONCE: OpenError =
    OpenError::new(OpenErrorKind::Refused, "the server closes the connection without a response");
const NO_SERVER: OpenError = OpenError::new(OpenErrorKind::NotFound, "");

/// Serves the dispatcher's requests forever.
pub(crate) async fn run<C: TcpConnect>(
    dispatcher: &Dispatcher<'_>,
    settings: &TcpClientSettings,
    connector: &C,
) -> ! {
    let port_state = dispatcher.port_state().state();
    let status = if settings.idle > Duration::from_ticks(0) { Status::Idle } else { Status::Off };
    dispatcher.set_all_statuses(status);
    let [never, ..] = join_array::<_, CONNECTIONS_MAX>(core::array::from_fn(|connection| {
        let socket = port_state.sockets.get(connection);
        let connection = connection as u8;
        async move {
            match socket.filter(|_| connection < dispatcher.connections()) {
                Some(socket) => {
                    ConnectionTask { dispatcher, settings, connector, connection, socket }.run().await
                }
                None => core::future::pending().await,
            }
        }
    }))
    .await;
    never
}

/// One connection of the port, which serves one server after another.
struct ConnectionTask<'c, 'g, C> {
    dispatcher: &'c Dispatcher<'g>,
    settings: &'c TcpClientSettings,
    connector: &'c C,
    connection: u8,
    socket: &'c Socket,
}

/// How a connection ended.
enum Outcome {
    /// The server seems healthy.
    Well,
    /// It is unreachable or silent.
    Failed(OpenError),
    /// The socket was needed elsewhere before it connected.
    PutOff,
}

impl<C: TcpConnect> ConnectionTask<'_, '_, C> {
    async fn run(&self) -> ! {
        let Self { dispatcher, settings, socket, .. } = self;
        let keeps = settings.idle == Duration::from_ticks(0);
        let mut first_id = u16::from(self.connection).wrapping_mul(ID_STRIDE);
        loop {
            let server = dispatcher.chosen(self.connection, keeps).await;
            let outcome = self.connect_and_serve(server, first_id).await;
            dispatcher.gateway().socket_closed(socket);
            first_id = first_id.wrapping_add(ID_STRIDE);
            match outcome {
                Outcome::Well => {
                    if !keeps {
                        dispatcher.set_status(server, Status::Idle);
                    }
                    dispatcher.disconnected(server);
                }
                Outcome::PutOff => dispatcher.put_off(server),
                Outcome::Failed(error) => {
                    let failed = Status::Failed(error);
                    if dispatcher.set_status(server, failed) != failed
                        && let Some(address) = dispatcher.address(server)
                    {
                        log_warn!("no connection to {}: {}", address, error);
                    }
                    dispatcher.failed_to_reach(server);
                }
            }
        }
    }

    /// Connects to `server`, and serves its requests until the connection ends.
    async fn connect_and_serve(&self, server: usize, first_id: u16) -> Outcome {
        let Self { dispatcher, settings, connection, socket, .. } = self;
        let stream = match self.connect(server).await {
            Ok(stream) => stream,
            Err(outcome) => return outcome,
        };
        // Borrowed, not moved: a future stores a moved argument twice.
        let mut open =
            TcpConnection::new(dispatcher, settings, stream, first_id, (*connection, server), socket);
        let Err(end) = outlined(pin!(open.serve())).await;
        let well = open.ended(end);
        open.into_stream().close().await;
        if well { Outcome::Well } else { Outcome::Failed(CLOSED_AT_ONCE) }
    }

    /// Connects to `server`. What that takes of the future's memory is the open connection's afterwards.
    async fn connect(&self, server: usize) -> Result<C::Stream<'_>, Outcome> {
        let Self { dispatcher, settings, connection, socket, .. } = self;
        let give_up = Instant::now() + settings.connect_timeout;
        let retry = !dispatcher.is_wanted(server);
        loop {
            socket.freed.reset();
            socket.opening(retry);
            let Some(address) = dispatcher.address(server) else { return Err(Outcome::Failed(NO_SERVER)) };
            let connected = with_deadline(give_up, self.open(&address));
            let error = match select(connected, socket.leave.wait()).await {
                Either::First(Ok(Ok(stream))) => {
                    let before = dispatcher.set_status(server, Status::Open);
                    if !matches!(before, Status::Open | Status::Idle) {
                        log_info!("connected to {}", address);
                    }
                    dispatcher.port_state().stats.count(Event::Connected);
                    socket.opened();
                    dispatcher.opened(server);
                    return Ok(stream);
                }
                Either::First(Ok(Err(error))) => error,
                Either::First(Err(_)) => OpenError::new(OpenErrorKind::TimedOut, ""),
                Either::Second(()) => return Err(Outcome::PutOff),
            };
            if error.kind != OpenErrorKind::Exhausted {
                return Err(Outcome::Failed(error));
            }
            let need = if retry { Need::Retry } else { Need::Request };
            let all = dispatcher.gateway().ports().iter().flat_map(|port_state| &port_state.sockets);
            socket::ask_for_one(all, need, Some((dispatcher.id(), *connection)));
            if Instant::now() >= give_up {
                return Err(Outcome::Failed(error));
            }
            let _ = with_timeout(SOCKET_PAUSE, socket.freed.wait()).await;
        }
    }
}
