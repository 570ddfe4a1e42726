//! Accepted TCP connections, and the options of all connections.

use core::net::{IpAddr, SocketAddr};

use embassy_net::tcp::{Error, State, TcpSocket};
use embassy_net::{IpEndpoint, IpListenEndpoint};
use embassy_time::Duration;
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::hal::{self, OpenError, OpenErrorKind, TcpHost};
use mobgate::settings::TcpListen;

use crate::closing::end;
use crate::pool::{PooledTcp, Sockets};

/// A peer that acknowledges nothing for this long is gone.
const PEER_TIMEOUT: Duration = Duration::from_secs(30);
/// Keep-alive interval of quiet peers.
const KEEPALIVE: Duration = Duration::from_secs(10);

pub(crate) const IPV4_ONLY: OpenError = OpenError::new(OpenErrorKind::Unsupported, "this board speaks IPv4");

/// Accepts connections. Each waiting host has its own listening socket, so several may wait on one port.
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
        let at = endpoint(self.0, listen)?;
        let mut pooled = self.0.tcp()?;
        let socket = pooled.get();
        // Before listening: a handshake that is never completed must time out, too.
        set_up(socket);
        loop {
            match (socket.accept(at).await, socket.remote_endpoint()) {
                (Ok(()), Some(peer)) => return Ok((TcpStream::new(pooled), address(peer))),
                // The peer gave up during the handshake.
                (Ok(()), None) => socket.abort(),
                (Err(_), _) => return Err(OpenError::new(OpenErrorKind::Failed, "")),
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
            pooled.sockets().end_later(pooled);
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
