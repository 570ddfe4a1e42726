//! A listening socket that several connection tasks wait on.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, TcpStream};

use async_lock::Mutex;
use embassy_time::{Duration, Timer};
use mobgate::config::TcpListen;
use mobgate::hal::{OpenError, OpenErrorKind};
use rustix::io::Errno;
use socket2::{Domain, Protocol, Socket, Type};

use super::options;
use crate::descriptor::Descriptor;
use crate::hint;

/// Connections that the kernel accepts ahead of us.
const BACKLOG: i32 = 1024;
/// Pause when the system has no descriptor or memory for one more connection.
const EXHAUSTED_PAUSE: Duration = Duration::from_millis(200);

/// A listening socket. Waiting tasks queue up, so that a connection wakes one of them and not all.
#[derive(Debug)]
pub struct Listener {
    socket: Mutex<Descriptor<TcpListener>>,
}

impl Listener {
    /// Listens at `listen`; without an address on every one, by IPv6 and IPv4 where the system has both.
    pub(super) fn open(listen: &TcpListen) -> Result<Self, OpenError> {
        let bound =
            match listen.address {
                Some(address) => bind((address, listen.port).into()),
                None => bind((Ipv6Addr::UNSPECIFIED, listen.port).into()).or_else(|error| {
                    match Errno::from_io_error(&error) {
                        Some(Errno::AFNOSUPPORT | Errno::ADDRNOTAVAIL) => {
                            bind((Ipv4Addr::UNSPECIFIED, listen.port).into())
                        }
                        _ => Err(error),
                    }
                }),
            };
        let socket = bound.and_then(Descriptor::new).map_err(|error| refusal(&error))?;
        Ok(Self { socket: Mutex::new(socket) })
    }

    /// The address and port that the socket is bound to, for a listener on port 0.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        match self.socket.try_lock() {
            Some(socket) => socket.get_ref().local_addr(),
            None => Err(io::ErrorKind::WouldBlock.into()),
        }
    }

    /// The next connection and its peer, an IPv4 peer as such also on a socket for both.
    pub(super) async fn accept(&self) -> (Descriptor<TcpStream>, SocketAddr) {
        let mut socket = self.socket.lock().await;
        loop {
            let accepted = socket.read_with(TcpListener::accept).await;
            match accepted.and_then(|(stream, peer)| Ok((Descriptor::new(stream)?, peer))) {
                Ok((stream, peer)) => {
                    return (stream, SocketAddr::new(peer.ip().to_canonical(), peer.port()));
                }
                Err(error) if is_exhausted(&error) => {
                    // The connection stays in the backlog, so that accepting again at once would spin.
                    log::warn!("a TCP connection has to wait: {error}");
                    Timer::after(EXHAUSTED_PAUSE).await;
                }
                // The connection ended before it was accepted (accept(2), "Error handling").
                Err(error) => log::debug!("a TCP connection was not accepted: {error}"),
            }
        }
    }
}

/// Whether the system has no descriptor or memory left.
pub(super) fn is_exhausted(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::MFILE | Errno::NFILE | Errno::NOBUFS | Errno::NOMEM))
}

fn bind(at: SocketAddr) -> io::Result<TcpListener> {
    let socket = Socket::new(Domain::for_address(at), Type::STREAM, Some(Protocol::TCP))?;
    if at.ip() == IpAddr::V6(Ipv6Addr::UNSPECIFIED) {
        socket.set_only_v6(false)?;
    }
    // Else a restarted program finds its port taken by its own closed connections (TIME_WAIT).
    socket.set_reuse_address(true)?;
    // Accepted sockets inherit these on Linux.
    options::set(&socket)?;
    socket.bind(&at.into())?;
    socket.listen(BACKLOG)?;
    Ok(socket.into())
}

/// What a system error means for the user.
pub(crate) fn refusal(error: &io::Error) -> OpenError {
    let (kind, hint) = match Errno::from_io_error(error) {
        Some(Errno::ACCESS | Errno::PERM) => (OpenErrorKind::Denied, hint::port_denied()),
        Some(Errno::ADDRINUSE) => (OpenErrorKind::InUse, "see who listens: ss -ltnp"),
        Some(Errno::ADDRNOTAVAIL | Errno::AFNOSUPPORT) => {
            (OpenErrorKind::NotFound, "no network interface has this address")
        }
        _ => (OpenErrorKind::Failed, ""),
    };
    OpenError::new(kind, hint)
}
