//! Connections that the gateway makes to outside servers.

use std::io;
use std::net::{SocketAddr, TcpStream as SystemStream};

use mobgate::hal::{OpenError, OpenErrorKind, TcpConnect};
use rustix::io::Errno;
use socket2::{Domain, Protocol, Socket, Type};

use super::listener::is_exhausted;
use super::{TcpStream, options};
use crate::descriptor::Descriptor;

/// Makes connections.
#[derive(Debug, Clone, Copy, Default)]
pub struct Connector;

impl TcpConnect for Connector {
    type Stream<'a> = TcpStream;

    async fn connect(&mut self, server: SocketAddr) -> Result<TcpStream, OpenError> {
        let mut stream = begin(server).map_err(|error| refusal(&error))?;
        let connected = stream.write_with(is_connected).await;
        connected.map(|()| TcpStream::new(stream, None)).map_err(|error| refusal(&error))
    }
}

/// A socket that is connecting.
fn begin(server: SocketAddr) -> io::Result<Descriptor<SystemStream>> {
    let socket = Socket::new(Domain::for_address(server), Type::STREAM, Some(Protocol::TCP))?;
    options::set(&socket)?;
    socket.set_nonblocking(true)?;
    match socket.connect(&server.into()) {
        Err(error) if Errno::from_io_error(&error) != Some(Errno::INPROGRESS) => Err(error),
        _ => Descriptor::new(socket.into()),
    }
}

/// Whether the connection has come about; `WouldBlock` as long as that is open (connect(2), EINPROGRESS).
fn is_connected(stream: &SystemStream) -> io::Result<()> {
    match (stream.take_error()?, stream.peer_addr()) {
        (Some(error), _) => Err(error),
        (None, Err(error)) if Errno::from_io_error(&error) == Some(Errno::NOTCONN) => {
            Err(io::ErrorKind::WouldBlock.into())
        }
        (None, peer) => peer.map(drop),
    }
}

/// What a system error means for the user.
fn refusal(error: &io::Error) -> OpenError {
    let (kind, hint) = match Errno::from_io_error(error) {
        Some(Errno::CONNREFUSED) => {
            (OpenErrorKind::Refused, "nobody listens there: is it the right TCP port?")
        }
        Some(Errno::CONNRESET) => (OpenErrorKind::Refused, "the server takes no connection now"),
        Some(Errno::TIMEDOUT) => (OpenErrorKind::TimedOut, ""),
        Some(Errno::HOSTUNREACH) => {
            (OpenErrorKind::NotFound, "no such machine in the network: is it switched on?")
        }
        Some(Errno::NETUNREACH | Errno::ADDRNOTAVAIL | Errno::AFNOSUPPORT) => {
            (OpenErrorKind::NotFound, "no way to that network: see ip route")
        }
        Some(Errno::ACCESS | Errno::PERM) => (OpenErrorKind::Denied, "a firewall forbids it"),
        _ if is_exhausted(error) => (OpenErrorKind::Exhausted, ""),
        _ => (OpenErrorKind::Failed, ""),
    };
    OpenError::new(kind, hint)
}
