//! A connection to the console: a Unix socket, TCP or SSH.

use std::io;
use std::net::{IpAddr, Shutdown, SocketAddr};
use std::os::unix::net::UnixStream;

use embassy_futures::select::select;
use embassy_time::{Duration, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use mobgate::console::Mode;
use mobgate::hal::TcpStream as _;
use rustix::net::{RecvFlags, recv};

use super::hello::Hello;
use super::peer::Peer;
use crate::descriptor::Descriptor;
use crate::ssh::{Entrant, Who};
use crate::tcp::TcpStream;

/// Time limit for the last words of a session and an orderly close.
const CLOSE_MAX: Duration = Duration::from_millis(250);

/// A client of the console.
#[derive(Debug)]
pub struct Guest {
    stream: Stream,
    pub(super) who: String,
    pub(super) hello: Hello,
    /// The authenticated user.
    pub(super) user: Option<Who>,
}

#[derive(Debug)]
enum Stream {
    Tcp(TcpStream, IpAddr),
    Local(Descriptor<UnixStream>),
}

impl Guest {
    /// A client connected by TCP from `peer`.
    pub(super) fn by_tcp(stream: TcpStream, peer: SocketAddr) -> Self {
        Self { stream: Stream::Tcp(stream, peer.ip()), who: peer.to_string(), hello: Hello::None, user: None }
    }

    /// The process `peer`, which is authorised to use the console.
    pub(super) fn by_socket(stream: UnixStream, peer: &Peer) -> io::Result<Self> {
        let stream = Stream::Local(Descriptor::new(stream)?);
        Ok(Self { stream, who: peer.to_string(), hello: Hello::None, user: None })
    }

    /// A user authenticated by SSH.
    pub(super) fn by_ssh(Entrant { stream, who: user, edits }: Entrant) -> io::Result<Self> {
        let hello = if edits { Hello::Terminal } else { Hello::Lines };
        let stream = Stream::Local(Descriptor::new(stream)?);
        let who = format!("{}@{}", user.user, user.peer);
        Ok(Self { stream, who, hello, user: Some(user) })
    }

    /// Waits for the first byte, which selects the mode of the session.
    pub(super) async fn begin(&mut self) -> io::Result<Mode<'static>> {
        let stream = match &mut self.stream {
            Stream::Tcp(_, peer) => return Ok(Mode::Network(*peer, None)),
            Stream::Local(stream) => stream,
        };
        let mut first = [0];
        stream.read_with(|stream| Ok(recv(stream, &mut first, RecvFlags::PEEK)?.1)).await?;
        self.hello = Hello::of(first[0]);
        if self.hello != Hello::None {
            self.read(&mut first).await?;
        }
        Ok(self.hello.mode())
    }

    /// Sends `last` and closes the connection; limits the time if the peer does not read.
    pub(super) async fn dismiss(mut self, last: &[u8]) {
        select(self.write_all(last), Timer::after(CLOSE_MAX)).await;
        match self.stream {
            Stream::Tcp(stream, _) => stream.close().await,
            // The peer can still read what was written.
            Stream::Local(stream) => drop(stream.get_ref().shutdown(Shutdown::Both)),
        }
    }
}

impl ErrorType for Guest {
    type Error = io::Error;
}

impl Read for Guest {
    async fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match &mut self.stream {
            Stream::Tcp(stream, _) => stream.read(into).await,
            Stream::Local(stream) => stream.read_stream(into).await,
        }
    }
}

impl Write for Guest {
    async fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        match &mut self.stream {
            Stream::Tcp(stream, _) => stream.write(from).await,
            Stream::Local(stream) => stream.write_stream(from).await,
        }
    }

    /// Nothing is buffered.
    async fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
