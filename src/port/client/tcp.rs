//! A client-side TCP port: the gateway asks outside servers, by Modbus TCP or RTU over TCP.
//!
//! A connection is opened when the first request for its server comes, and closed when none has come for the idle time; with
//! `idle 0` it is opened at once and kept. While it is open, [`TcpConnection`] carries the requests out. A port with several servers has
//! connections to as many at a time as its `sockets`: [`servers`](crate::port::client::servers) says to which.
//!
//! When a server cannot be reached, what waits and what comes for it is answered 0Ah at once: there is no path, so nothing has
//! been sent and nothing has happened at the device. 0Bh says the other thing: it was sent, or may have been, and no valid
//! answer came. Meanwhile the connection is tried again in the background, at growing intervals, so that no request has to
//! wait for the network's time-out but the first, and those of a requester with a back-off of his own, who makes such a try.

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

/// Pause before another look for a socket: others than ports that make connections use some, too.
const SOCKET_PAUSE: Duration = Duration::from_millis(50);
/// Transaction ids of a connection begin so far behind those of the one before: a server that mixes them up is found out.
const ID_STRIDE: u16 = 4_099;

const CLOSED_AT_ONCE: OpenError =
    OpenError::new(OpenErrorKind::Refused, "the server closes the connection without an answer");
const NO_SERVER: OpenError = OpenError::new(OpenErrorKind::NotFound, "");

/// Carries out the dispatcher's requests, for ever.
pub(crate) async fn run<C: TcpConnect>(
    dispatcher: &Dispatcher<'_>,
    settings: &TcpClientSettings,
    connector: &C,
) {
    let port_state = dispatcher.port_state().state();
    let status = if settings.idle > Duration::from_ticks(0) { Status::Idle } else { Status::Off };
    dispatcher.set_all_statuses(status);
    join_array::<_, CONNECTIONS_MAX>(core::array::from_fn(|connection| {
        let socket = port_state.sockets.get(connection);
        let connection = connection as u8;
        async move {
            match socket.filter(|_| connection < dispatcher.connections()) {
                Some(socket) => Caller { dispatcher, settings, connector, connection, socket }.run().await,
                None => core::future::pending().await,
            }
        }
    }))
    .await;
}

/// Connects to one server after the other.
struct Caller<'c, 'g, C> {
    dispatcher: &'c Dispatcher<'g>,
    settings: &'c TcpClientSettings,
    connector: &'c C,
    connection: u8,
    socket: &'c Socket,
}

/// What came of a connection.
enum Visit {
    /// The server is well as far as one can tell.
    Well,
    /// It cannot be reached, or says nothing.
    Failed(OpenError),
    /// The socket was needed elsewhere before there was one.
    PutOff,
}

impl<C: TcpConnect> Caller<'_, '_, C> {
    async fn run(&self) {
        let Self { dispatcher, settings, socket, .. } = self;
        let keeps = settings.idle == Duration::from_ticks(0);
        let mut first_id = u16::from(self.connection).wrapping_mul(ID_STRIDE);
        loop {
            let server = dispatcher.chosen(self.connection, keeps).await;
            let visit = self.visit(server, first_id).await;
            dispatcher.gateway().socket_closed(socket);
            first_id = first_id.wrapping_add(ID_STRIDE);
            match visit {
                Visit::Well => {
                    if !keeps {
                        dispatcher.set_status(server, Status::Idle);
                    }
                    dispatcher.left(server);
                }
                Visit::PutOff => dispatcher.put_off(server),
                Visit::Failed(error) => {
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

    /// Connects to `server`, and carries out its requests until the connection ends.
    async fn visit(&self, server: usize, first_id: u16) -> Visit {
        let Self { dispatcher, settings, connector, connection, socket } = self;
        let give_up = Instant::now() + settings.connect_timeout;
        let retry = !dispatcher.is_wanted(server);
        loop {
            socket.freed.reset();
            socket.opening(retry);
            let Some(address) = dispatcher.address(server) else { return Visit::Failed(NO_SERVER) };
            let connected = with_deadline(give_up, connector.connect(&address));
            let error = match select(connected, socket.leave.wait()).await {
                Either::First(Ok(Ok(stream))) => {
                    let before = dispatcher.set_status(server, Status::Open);
                    if !matches!(before, Status::Open | Status::Idle) {
                        log_info!("connected to {}", address);
                    }
                    dispatcher.port_state().stats.count(Event::Connected);
                    socket.opened();
                    dispatcher.opened(server);
                    // Lent and not moved: what a future is given it keeps twice.
                    let mut open = TcpConnection::new(
                        dispatcher,
                        settings,
                        stream,
                        first_id,
                        (*connection, server),
                        socket,
                    );
                    let Err(end) = outlined(pin!(open.serve())).await;
                    let well = open.ended(end);
                    open.into_stream().close().await;
                    return if well { Visit::Well } else { Visit::Failed(CLOSED_AT_ONCE) };
                }
                Either::First(Ok(Err(error))) => error,
                Either::First(Err(_)) => OpenError::new(OpenErrorKind::TimedOut, ""),
                Either::Second(()) => return Visit::PutOff,
            };
            if error.kind != OpenErrorKind::Exhausted {
                return Visit::Failed(error);
            }
            let need = if retry { Need::Retry } else { Need::Order };
            let all = dispatcher.gateway().ports().iter().flat_map(|port_state| &port_state.sockets);
            socket::ask_for_one(all, need, Some((dispatcher.id(), *connection)));
            if Instant::now() >= give_up {
                return Visit::Failed(error);
            }
            let _ = with_timeout(SOCKET_PAUSE, socket.freed.wait()).await;
        }
    }
}
