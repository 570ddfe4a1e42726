//! TCP and UDP sockets.

use core::net::{IpAddr, SocketAddr};

use embedded_io_async::{Read, Write};

use super::{OpenError, OpenErrorKind};
use crate::settings::{ClientRole, PortId, ServerAddress, TcpListen};

const NO_TLS: OpenError = OpenError::new(OpenErrorKind::Unsupported, "this board has no TLS");

/// Accepts TCP connections, one at a time; every connection task owns one.
///
/// Several hosts may accept at the same address: they share the listening socket.
pub trait TcpHost {
    /// An accepted connection, with Nagle off, keepalive and user time-out set.
    type Stream<'a>: TcpStream
    where
        Self: 'a;

    /// Opens the listening socket at `listen`, if the board has such sockets, so that errors appear before the first client
    /// connects.
    fn listen(&mut self, listen: &TcpListen) -> Result<(), OpenError>;

    /// An address outside private networks at which a server at `listen` is reached, on systems that know.
    fn public_address(&self, _listen: &TcpListen) -> Option<IpAddr> {
        None
    }

    /// Fails if clients of the port `port` of the settings, which speaks TLS, could not be served: the board has no TLS, or a
    /// certificate cannot be used.
    fn prepare_tls(&self, _port: PortId) -> Result<(), OpenError> {
        Err(NO_TLS)
    }

    /// Waits for the next connection at `listen` and returns it with the peer's address. Dropping the pending future loses no
    /// connection.
    async fn accept(&mut self, listen: &TcpListen) -> Result<(Self::Stream<'_>, SocketAddr), OpenError>;
}

/// Makes TCP connections to outside servers, several at a time; every port task has one.
pub trait TcpConnect {
    /// A connection, with Nagle off, keepalive and user time-out set.
    type Stream<'a>: TcpStream
    where
        Self: 'a;

    /// Connects to `server`, resolving its name if it has one; [`OpenErrorKind::Exhausted`] when all sockets of the board are in
    /// use. The caller limits the time by dropping the pending future.
    async fn connect(&self, server: &ServerAddress) -> Result<Self::Stream<'_>, OpenError>;

    /// Waits for the next connection that is [handed over](TcpStream::hand_over) to the port `port`, and returns it with its peer.
    /// Dropping the pending future loses none.
    async fn handed_over(&self, _port: PortId) -> (Self::Stream<'_>, SocketAddr) {
        core::future::pending().await
    }
}

/// A TCP connection. `read` returns `Ok(0)` after the peer's FIN; dropping a pending `read` loses no byte.
pub trait TcpStream: Read + Write {
    /// Closes the connection gracefully, within a bounded time.
    async fn close(self);

    /// Hands the connection of `peer` over to the client port `port`, which waits in [`TcpConnect::handed_over`]. One that waits there
    /// is dropped for it. On boards without such ports the connection ends.
    fn hand_over(self, _port: PortId, _peer: SocketAddr)
    where
        Self: Sized,
    {
    }

    /// Begins TLS, for the port or publisher `port` of the settings ([`Settings::tls`](crate::settings::Settings::tls)): as the client
    /// of `server`, or else as a server of who has connected. From then on the connection carries what TLS carries. Returns the role in a
    /// client's certificate. Fails unless the peer has a certificate that the settings of the port accept, with the reason. The caller
    /// limits the time.
    async fn secure(
        &mut self,
        _port: PortId,
        _server: Option<&ServerAddress>,
    ) -> Result<ClientRole, OpenError> {
        Err(NO_TLS)
    }

    /// Serves the console by SSH, at a port of the settings, until the connection ends, and calls `logged_in` once somebody has logged
    /// in. Dropping the future ends the connection. Boards without SSH end it at once.
    async fn serve_ssh(&mut self, _port: PortId, _peer: SocketAddr, _logged_in: &dyn Fn()) {}
}

/// Opens UDP sockets; every port task owns one.
pub trait UdpHost {
    /// An open socket.
    type Socket<'a>: UdpSocket
    where
        Self: 'a;

    /// Opens a socket at `listen`'s address and UDP port.
    async fn bind(&mut self, listen: &TcpListen) -> Result<Self::Socket<'_>, OpenError>;
}

/// A UDP socket. Datagrams may be lost, duplicated or reordered; dropping a pending `receive` loses none.
pub trait UdpSocket {
    /// Waits for a datagram, and returns its length and sender. A longer one than `into` is truncated.
    async fn receive(&mut self, into: &mut [u8]) -> Result<(usize, SocketAddr), SocketLost>;

    /// Sends a datagram. An absent receiver is not an error.
    async fn send(&mut self, datagram: &[u8], to: SocketAddr) -> Result<(), SocketLost>;
}

/// The socket has failed and must be reopened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SocketLost;
