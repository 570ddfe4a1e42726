//! Accepted TCP connections, and how any connection is set up.

use core::net::{IpAddr, SocketAddr};

use embassy_net::tcp::{Error, State, TcpSocket};
use embassy_net::{IpEndpoint, IpListenEndpoint};
use embassy_time::Duration;
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::hal::{self, OpenError, OpenErrorKind, TcpHost};
use mobgate::settings::TcpListen;

use crate::closing::end;
use crate::pool::{PooledTcp, Sockets};

/// Time after which a peer that acknowledges nothing is gone.
const PEER_TIMEOUT: Duration = Duration::from_secs(30);
/// A quiet peer is asked so often whether it is still there.
const KEEPALIVE: Duration = Duration::from_secs(10);

pub(crate) const IPV4_ONLY: OpenError = OpenError::new(OpenErrorKind::Unsupported, "this board speaks IPv4");

/// Accepts connections. Each host that waits has a listening socket of its own, so several may wait at one port.
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
        // Before it listens: a handshake that is never finished must end, too.
        set_up(socket);
        loop {
            match (socket.accept(at).await, socket.remote_endpoint()) {
                (Ok(()), Some(peer)) => return Ok((TcpStream::new(pooled), address(peer))),
                // It ended before it had begun: a peer that never finished the handshake.
                (Ok(()), None) => socket.abort(),
                (Err(_), _) => return Err(OpenError::new(OpenErrorKind::Failed, "")),
            }
        }
    }
}

/// Where embassy-net shall listen.
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

/// What is set on every connection: Nagle off, and an end to half-open connections.
pub(crate) fn set_up(socket: &mut TcpSocket<'static>) {
    socket.set_nagle_enabled(false);
    socket.set_keep_alive(Some(KEEPALIVE));
    socket.set_timeout(Some(PEER_TIMEOUT));
}

/// A connection, accepted or made. One that is dropped and not closed is ended by [`Sockets::run`].
pub struct TcpStream(Option<PooledTcp>);

impl TcpStream {
    /// A stream over a socket that is connected.
    pub(crate) fn new(connected: PooledTcp) -> Self {
        Self(Some(connected))
    }

    fn socket(&mut self) -> Result<&mut TcpSocket<'static>, Error> {
        // It is gone while the stream is being closed or dropped only.
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

    /// Nothing is held back: Nagle is off. embassy-net's own flush would wait for the peer's acknowledgement.
    async fn flush(&mut self) -> Result<(), Error> {
        Ok(())
    }
}
