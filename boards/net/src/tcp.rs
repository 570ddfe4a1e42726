//! Accepted TCP connections, and the options of all connections.

use core::future::{Future, poll_fn};
use core::net::{IpAddr, SocketAddr};
use core::pin::pin;
use core::task::Poll;

use embassy_futures::poll_once;
use embassy_net::tcp::{Error, State, TcpSocket};
use embassy_net::{IpEndpoint, IpListenEndpoint};
use embassy_time::Duration;
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::hal::{self, OpenError, OpenErrorKind, TcpHost};
use mobgate::settings::TcpListen;

use crate::closing::end;
#[cfg(feature = "ssh")] // Images without it have no console by network; also below.
use crate::lobby::Guest;
use crate::pool::{Lease, PooledTcp, Sockets};

/// A peer that acknowledges nothing for this long is gone.
const PEER_TIMEOUT: Duration = Duration::from_secs(30);
/// Keep-alive interval of quiet peers.
const KEEPALIVE: Duration = Duration::from_secs(10);

pub(crate) const IPV4_ONLY: OpenError = OpenError::new(OpenErrorKind::Unsupported, "this board speaks IPv4");

/// Accepts connections. Several hosts may wait on one port: each has a socket of its own, and a few of them listen at a time.
#[derive(Clone, Copy)]
pub struct TcpSockets(&'static Sockets);

impl TcpSockets {
    /// Takes its sockets from `sockets`.
    pub const fn new(sockets: &'static Sockets) -> Self {
        Self(sockets)
    }
}

impl TcpHost for TcpSockets {
    type Stream<'a> = TcpStream;

    fn listen(&mut self, listen: &TcpListen) -> Result<(), OpenError> {
        endpoint(self.0, listen).map(drop)
    }

    async fn accept(&mut self, listen: &TcpListen) -> Result<(TcpStream, SocketAddr), OpenError> {
        loop {
            // Before the turn: nobody else gets the buffer meanwhile.
            let lease = Lease::take(self.0)?;
            let mut turn = Some(self.0.backlog.turn(listen.port, lease.number).await);
            let at = endpoint(self.0, listen)?;
            let mut pooled = PooledTcp::new(lease);
            let socket = pooled.get();
            // Before listening: a handshake that is never completed must time out, too.
            set_up(socket);
            if let Poll::Ready(Err(_)) = poll_once(socket.accept(at)) {
                return Err(OpenError::new(OpenErrorKind::Failed, ""));
            }
            poll_fn(|context| {
                // Each change of the state wakes who waits to write, which none of these states allows.
                let _ = pin!(socket.wait_write_ready()).poll(context);
                let state = socket.state();
                if state == State::Listen && turn.is_some() {
                    return Poll::Pending;
                }
                if let Some(turn) = turn.take() {
                    turn.accepted();
                }
                if state == State::SynReceived { Poll::Pending } else { Poll::Ready(()) }
            })
            .await;
            // If there is none, the peer gave up during the handshake.
            if let Some(peer) = socket.remote_endpoint() {
                return Ok((TcpStream::new(pooled), address(peer)));
            }
        }
    }
}

/// The endpoint for embassy-net to listen on.
pub(crate) fn endpoint(sockets: &Sockets, listen: &TcpListen) -> Result<IpListenEndpoint, OpenError> {
    match listen.address {
        None => Ok(listen.port.into()),
        Some(IpAddr::V4(address)) if address.is_unspecified() => Ok(listen.port.into()),
        Some(IpAddr::V4(address)) => {
            let own = sockets.stack.config_v4().is_some_and(|config| config.address.address() == address);
            let hint = "this board has another address now: see show network";
            if own {
                Ok((address, listen.port).into())
            } else {
                Err(OpenError::new(OpenErrorKind::NotFound, hint))
            }
        }
        Some(IpAddr::V6(_)) => Err(IPV4_ONLY),
    }
}

pub(crate) fn address(endpoint: IpEndpoint) -> SocketAddr {
    SocketAddr::new(endpoint.addr.into(), endpoint.port)
}

/// Sets the options of every connection: Nagle off, and time-outs for half-open connections.
pub(crate) fn set_up(socket: &mut TcpSocket<'static>) {
    socket.set_nagle_enabled(false);
    socket.set_keep_alive(Some(KEEPALIVE));
    socket.set_timeout(Some(PEER_TIMEOUT));
}

/// A connection, incoming or outgoing. [`Sockets::run`] closes those dropped without closing.
pub struct TcpStream(Option<PooledTcp>);

impl TcpStream {
    /// A stream over a connected socket.
    pub(crate) fn new(connected: PooledTcp) -> Self {
        Self(Some(connected))
    }

    fn socket(&mut self) -> Result<&mut TcpSocket<'static>, Error> {
        // `None` only while the stream is being closed or dropped.
        self.0.as_mut().map(PooledTcp::get).ok_or(Error::ConnectionReset)
    }
}

impl hal::TcpStream for TcpStream {
    #[cfg(feature = "ssh")]
    async fn serve_ssh(&mut self, port: mobgate::settings::PortId, peer: SocketAddr, logged_in: &dyn Fn()) {
        let Some(sockets) = self.0.as_ref().map(PooledTcp::sockets) else { return };
        // The connection stays here, and is ended in order, until it is taken over.
        let Some(slot) = sockets.lobby.free_slot().await else { return };
        if let Some(connection) = self.0.take() {
            slot.take(Guest { connection, port, peer: peer.ip() }, logged_in).await;
        }
    }

    async fn close(mut self) {
        if let Some(mut pooled) = self.0.take() {
            end(pooled.get()).await;
        }
    }
}

impl Drop for TcpStream {
    fn drop(&mut self) {
        if let Some(mut pooled) = self.0.take()
            && pooled.get().state() != State::Closed
        {
            pooled.end_later();
        }
    }
}

impl ErrorType for TcpStream {
    type Error = Error;
}

impl Read for TcpStream {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Error> {
        self.socket()?.read(into).await
    }
}

impl Write for TcpStream {
    async fn write(&mut self, from: &[u8]) -> Result<usize, Error> {
        self.socket()?.write(from).await
    }

    /// Nothing is buffered here: Nagle is off. embassy-net's own flush would wait for the peer's acknowledgement.
    async fn flush(&mut self) -> Result<(), Error> {
        Ok(())
    }
}
