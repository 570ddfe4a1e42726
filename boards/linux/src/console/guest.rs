//! A connection to the console: a socket of this machine, or TCP.

use std::io::{self, Read as _, Write as _};
use std::net::{Shutdown, SocketAddr};
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
use crate::tcp::TcpStream;

/// Time that the last words of a session may take, and its orderly end.
const CLOSE_MAX: Duration = Duration::from_millis(250);

/// Who wants a session.
#[derive(Debug)]
pub struct Guest {
    stream: Stream,
    pub(super) who: String,
    pub(super) hello: Hello,
}

#[derive(Debug)]
enum Stream {
    Tcp(TcpStream),
    Local(Descriptor<UnixStream>),
}

impl Guest {
    /// Whoever has connected from `peer`.
    pub(super) fn by_tcp(stream: TcpStream, peer: SocketAddr) -> Self {
        Self { stream: Stream::Tcp(stream), who: peer.to_string(), hello: Hello::None }
    }

    /// The process `peer`, which may use the console.
    pub(super) fn by_socket(stream: UnixStream, peer: &Peer) -> io::Result<Self> {
        let stream = Stream::Local(Descriptor::new(stream)?);
        Ok(Self { stream, who: peer.to_string(), hello: Hello::None })
    }

    /// Waits for the first byte, which says what kind of session this is.
    pub(super) async fn begin(&mut self) -> io::Result<Mode> {
        let Stream::Local(stream) = &mut self.stream else { return Ok(Mode::Network) };
        let mut first = [0];
        stream.read_with(|stream| Ok(recv(stream, &mut first, RecvFlags::PEEK)?.1)).await?;
        self.hello = Hello::of(first[0]);
        if self.hello != Hello::None {
            self.read(&mut first).await?;
        }
        Ok(self.hello.mode())
    }

    /// Says `last`, and closes the connection in order; not for long, if the peer does not take it.
    pub(super) async fn dismiss(mut self, last: &[u8]) {
        select(self.write_all(last), Timer::after(CLOSE_MAX)).await;
        match self.stream {
            Stream::Tcp(stream) => stream.close().await,
            // What is written stays to be read.
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
            Stream::Tcp(stream) => stream.read(into).await,
            Stream::Local(stream) => stream.read_stream(into, |mut stream, into| stream.read(into)).await,
        }
    }
}

impl Write for Guest {
    async fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        match &mut self.stream {
            Stream::Tcp(stream) => stream.write(from).await,
            Stream::Local(stream) => stream.write_with(|mut stream| stream.write(from)).await,
        }
    }

    /// Nothing is held back.
    async fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
