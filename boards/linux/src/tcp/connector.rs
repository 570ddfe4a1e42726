//! Outgoing connections of the gateway to servers.
//!
//! The system resolves names in a separate thread, since that may take long. All addresses are tried, in the system's order.

use std::io;
use std::net::{SocketAddr, TcpStream as SystemStream, ToSocketAddrs};
use std::rc::Rc;

use embassy_time::{Duration, with_timeout};
use mobgate::hal::{OpenError, OpenErrorKind, TcpConnect};
use mobgate::settings::{Host, PortId, ServerAddress};
use rustix::io::Errno;
use socket2::{Domain, Protocol, Socket, Type};

use super::listener::is_exhausted;
use super::{HANDOVER, TcpStream, options};
use crate::descriptor::Descriptor;
use crate::worker;

/// Time limit of an address if there is another one to try.
const PATIENCE: Duration = Duration::from_millis(500);

const NO_NAME: OpenError = OpenError::new(
    OpenErrorKind::NotFound,
    "the name is not known: is it right, and does the name server respond?",
);

/// Opens outgoing connections.
#[derive(Debug, Clone, Copy, Default)]
pub struct Connector;

impl TcpConnect for Connector {
    type Stream<'a> = TcpStream;

    async fn connect(&self, server: &ServerAddress) -> Result<TcpStream, OpenError> {
        let mut addresses = addresses_of(server).await?.into_iter().peekable();
        let mut error = NO_NAME;
        while let Some(address) = addresses.next() {
            let connecting = connect(address);
            let connected = match addresses.peek() {
                Some(_) => with_timeout(PATIENCE, connecting).await,
                // The caller limits the time.
                None => Ok(connecting.await),
            };
            match connected {
                Ok(Ok(stream)) => return Ok(stream),
                Ok(Err(refused)) => error = refused,
                Err(_) => error = OpenError::new(OpenErrorKind::TimedOut, ""),
            }
        }
        Err(error)
    }

    async fn handed_over(&self, port: PortId) -> (TcpStream, SocketAddr) {
        HANDOVER.with(Rc::clone).take(port).await
    }
}

async fn connect(address: SocketAddr) -> Result<TcpStream, OpenError> {
    let mut stream = begin(address).map_err(|error| refusal(&error))?;
    let connected = stream.write_with(is_connected).await;
    connected.map(|()| TcpStream::new(stream, None)).map_err(|error| refusal(&error))
}

/// The addresses of `server`.
pub(crate) async fn addresses_of(server: &ServerAddress) -> Result<Vec<SocketAddr>, OpenError> {
    match &server.host {
        Host::Address(address) => Ok(vec![SocketAddr::new(*address, server.port)]),
        Host::Name(name) => look_up(name.as_str().to_owned(), server.port).await,
    }
}

/// Resolves the host `name`.
async fn look_up(name: String, port: u16) -> Result<Vec<SocketAddr>, OpenError> {
    let looked_up = worker::once(move || (name.as_str(), port).to_socket_addrs()).await;
    let addresses =
        looked_up.map_err(|_| OpenError::new(OpenErrorKind::Failed, "no thread for a look-up"))?;
    addresses.map(Iterator::collect).map_err(|_| NO_NAME)
}

/// Starts connecting a socket.
fn begin(server: SocketAddr) -> io::Result<Descriptor<SystemStream>> {
    let socket = Socket::new(Domain::for_address(server), Type::STREAM, Some(Protocol::TCP))?;
    options::set(&socket)?;
    socket.set_nonblocking(true)?;
    match socket.connect(&server.into()) {
        Err(error) if Errno::from_io_error(&error) != Some(Errno::INPROGRESS) => Err(error),
        _ => Descriptor::new(socket.into()),
    }
}

/// Whether the connection is established; `WouldBlock` while pending (connect(2), EINPROGRESS).
fn is_connected(stream: &SystemStream) -> io::Result<()> {
    match (stream.take_error()?, stream.peer_addr()) {
        (Some(error), _) => Err(error),
        (None, Err(error)) if Errno::from_io_error(&error) == Some(Errno::NOTCONN) => {
            Err(io::ErrorKind::WouldBlock.into())
        }
        (None, peer) => peer.map(drop),
    }
}

/// Maps a system error to the user's.
pub(crate) fn refusal(error: &io::Error) -> OpenError {
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
