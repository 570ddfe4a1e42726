//! A listening socket shared by several connection tasks.

use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};

use async_lock::Mutex;
use embassy_time::{Duration, Timer};
use mobgate::hal::OpenError;
use mobgate::settings::TcpListen;
use rustix::io::Errno;
use socket2::{Protocol, Type};

use super::options;
use crate::bind;
use crate::descriptor::Descriptor;

/// Connections that the kernel accepts in advance.
const BACKLOG: i32 = 1024;
/// Pause when the system has no descriptor or memory for another connection.
const EXHAUSTED_PAUSE: Duration = Duration::from_millis(200);

/// A listening socket. Waiting tasks queue up, so that a connection wakes only one of them.
#[derive(Debug)]
pub struct Listener {
    socket: Mutex<Descriptor<TcpListener>>,
}

impl Listener {
    /// Starts listening at `listen`.
    pub(super) fn open(listen: &TcpListen) -> Result<Self, OpenError> {
        let socket = bind::at(listen, listening)?;
        Ok(Self { socket: Mutex::new(socket) })
    }

    /// The address and port that the socket is bound to, for a listener on port 0.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        match self.socket.try_lock() {
            Some(socket) => socket.get_ref().local_addr(),
            None => Err(io::ErrorKind::WouldBlock.into()),
        }
    }

    /// The next connection and its peer; IPv4 peers have IPv4 addresses even on a dual-stack socket.
    pub(super) async fn accept(&self) -> (Descriptor<TcpStream>, SocketAddr) {
        let mut socket = self.socket.lock().await;
        loop {
            let accepted = socket.read_with(TcpListener::accept).await;
            match accepted.and_then(|(stream, peer)| Ok((Descriptor::new(stream)?, peer))) {
                Ok((stream, peer)) => {
                    return (stream, SocketAddr::new(peer.ip().to_canonical(), peer.port()));
                }
                Err(error) if is_exhausted(&error) => {
                    // The connection stays in the backlog, so accepting again at once would spin.
                    log::warn!("a TCP connection has to wait: {error}");
                    Timer::after(EXHAUSTED_PAUSE).await;
                }
                // The connection ended before it was accepted (accept(2), "Error handling").
                Err(error) => log::debug!("a TCP connection was not accepted: {error}"),
            }
        }
    }
}

/// Whether the system has run out of descriptors or memory.
pub(super) fn is_exhausted(error: &io::Error) -> bool {
    matches!(Errno::from_io_error(error), Some(Errno::MFILE | Errno::NFILE | Errno::NOBUFS | Errno::NOMEM))
}

fn listening(at: SocketAddr) -> io::Result<TcpListener> {
    let socket = bind::socket(at, Type::STREAM, Protocol::TCP)?;
    // Otherwise a restarted program finds its port taken by its own closed connections (TIME_WAIT).
    socket.set_reuse_address(true)?;
    // Accepted sockets inherit these on Linux.
    options::set(&socket)?;
    socket.bind(&at.into())?;
    socket.listen(BACKLOG)?;
    Ok(socket.into())
}
