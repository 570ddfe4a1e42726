//! Connections that the gateway makes to outside servers.

use std::io;
use std::net::{SocketAddr, TcpStream as SystemStream};

use async_io::Async;
use mobgate::hal::{OpenError, OpenErrorKind, TcpConnect};
use rustix::io::Errno;
use socket2::SockRef;

use super::listener::is_exhausted;
use super::{TcpStream, options};

/// Makes connections.
#[derive(Debug, Clone, Copy, Default)]
pub struct Connector;

impl TcpConnect for Connector {
    type Stream<'a> = TcpStream;

    async fn connect(&mut self, server: SocketAddr) -> Result<TcpStream, OpenError> {
        let connected = Async::<SystemStream>::connect(server).await;
        let tuned = connected.and_then(|stream| options::set(&SockRef::from(&stream)).map(|()| stream));
        tuned.map(|stream| TcpStream::new(stream, None)).map_err(|error| refusal(&error))
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
