//! TCP connections: hosts with shared listening sockets, accepted streams, and a connector to other servers.
//!
//! A connection task asks its host for the next connection at an address. The first one opens the listener, which closes when no
//! task waits on it and none of its connections is left.

use std::cell::RefCell;
use std::io;
use std::net::{IpAddr, Shutdown, SocketAddr};
use std::os::fd::{AsFd, BorrowedFd};
use std::rc::{Rc, Weak};

use embassy_time::{Duration, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use futures_lite::future::or;
use mobgate::hal::{self, OpenError, TcpHost};
use mobgate::settings::{ClientRole, PortId, ServerAddress, TcpListen};

use crate::descriptor::Descriptor;
use crate::tls::{self, Session};
use crate::{exposure, ssh};

mod connector;
mod handover;
mod listener;
mod options;

pub use connector::Connector;
pub(crate) use connector::{addresses_of, refusal};
use handover::Handover;
pub use listener::Listener;

thread_local! {
    static HANDOVER: Rc<Handover<TcpStream>> = Rc::new(Handover::new());
}

/// Time limit of an orderly close.
const CLOSE_MAX: Duration = Duration::from_millis(250);

/// Accepts connections; clones share the listeners.
#[derive(Debug, Clone, Default)]
pub struct TcpSockets {
    listeners: Rc<RefCell<Vec<Shared>>>,
    /// Opened by `listen`, for the `accept` that follows.
    next: Option<Rc<Listener>>,
}

/// A listener held by some connection task, and its address.
type Shared = (TcpListen, Weak<Listener>);

impl TcpSockets {
    /// The listener at `listen`, opened if necessary. It stays open as long as it is held.
    pub fn open(&self, listen: &TcpListen) -> Result<Rc<Listener>, OpenError> {
        let mut listeners = self.listeners.borrow_mut();
        listeners.retain(|(_, listener)| listener.strong_count() > 0);
        let known = listeners.iter().find(|(at, _)| at == listen).and_then(|(_, known)| known.upgrade());
        if let Some(known) = known {
            return Ok(known);
        }
        let opened = Rc::new(Listener::open(listen)?);
        listeners.push((*listen, Rc::downgrade(&opened)));
        Ok(opened)
    }
}

impl TcpHost for TcpSockets {
    type Stream<'a> = TcpStream;

    fn listen(&mut self, listen: &TcpListen) -> Result<(), OpenError> {
        self.next = Some(self.open(listen)?);
        Ok(())
    }

    fn public_address(&self, listen: &TcpListen) -> Option<IpAddr> {
        exposure::public_address(listen)
    }

    fn prepare_tls(&self, port: PortId) -> Result<(), OpenError> {
        tls::prepare(port)
    }

    async fn accept(&mut self, listen: &TcpListen) -> Result<(TcpStream, SocketAddr), OpenError> {
        let listener = self.open(listen)?;
        self.next = None;
        let (io, peer) = listener.accept().await;
        Ok((TcpStream::new(io, Some(listener)), peer))
    }
}

/// A connection, incoming or outgoing.
#[derive(Debug)]
pub struct TcpStream {
    io: Descriptor<std::net::TcpStream>,
    /// Once TLS has begun.
    session: Option<Box<Session>>,
    /// Keeps the listener open while its only connection task is busy, so that new clients are not refused.
    _listener: Option<Rc<Listener>>,
}

impl TcpStream {
    fn new(io: Descriptor<std::net::TcpStream>, listener: Option<Rc<Listener>>) -> Self {
        Self { io, session: None, _listener: listener }
    }
}

impl hal::TcpStream for TcpStream {
    async fn secure(
        &mut self,
        port: PortId,
        server: Option<&ServerAddress>,
    ) -> Result<ClientRole, OpenError> {
        let (session, role) = tls::begin(&mut self.io, port, server).await?;
        self.session = Some(Box::new(session));
        Ok(role)
    }

    fn hand_over(self, port: PortId, peer: SocketAddr) {
        HANDOVER.with(Rc::clone).put(port, self, peer);
    }

    async fn serve_ssh(&mut self, port: PortId, peer: SocketAddr, logged_in: &dyn Fn()) {
        ssh::serve(self.io.get_ref(), port, peer, logged_in).await
    }

    async fn close(mut self) {
        // A socket closed with unread bytes sends a reset, which may overtake the last response: read them first.
        let drain = async {
            if let Some(session) = &mut self.session {
                let _ = session.close(&mut self.io).await;
            }
            if self.io.get_ref().shutdown(Shutdown::Write).is_ok() {
                let mut rest = [0; 1024];
                while self.read(&mut rest).await.is_ok_and(|count| count > 0) {}
            }
        };
        let too_long = async {
            Timer::after(CLOSE_MAX).await;
        };
        or(drain, too_long).await;
    }
}

impl AsFd for TcpStream {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.io.as_fd()
    }
}

impl ErrorType for TcpStream {
    type Error = io::Error;
}

impl Read for TcpStream {
    async fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match &mut self.session {
            None => self.io.read_stream(into).await,
            Some(session) => session.read(&mut self.io, into).await,
        }
    }
}

impl Write for TcpStream {
    async fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        match &mut self.session {
            None => self.io.write_stream(from).await,
            Some(session) => session.write(&mut self.io, from).await,
        }
    }

    /// Nothing is buffered: Nagle is off.
    async fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
