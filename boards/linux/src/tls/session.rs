//! A TLS connection over a socket of the reactor.

use std::io::{self, Read as _, Write as _};
use std::net::TcpStream;

use rustls::Connection;
use rustls::pki_types::CertificateDer;

use crate::descriptor::Descriptor;

/// Bytes read from the socket at a time: several requests, and no more than the connection buffers.
const RECEIVED_BYTES: usize = 4096;

type Socket = Descriptor<TcpStream>;

/// An open connection.
#[derive(Debug)]
pub(crate) struct Session {
    connection: Connection,
    received: Box<[u8; RECEIVED_BYTES]>,
}

impl Session {
    /// Performs the handshake. The I/O error wraps an error of TLS.
    pub(super) async fn begin(io: &mut Socket, connection: Connection) -> io::Result<Self> {
        let mut session = Self { connection, received: Box::new([0; RECEIVED_BYTES]) };
        session.flush(io).await?;
        while session.connection.is_handshaking() {
            if session.receive(io).await? == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
        }
        Ok(session)
    }

    /// The certificate that the peer has shown.
    pub(super) fn peer_certificate(&self) -> Option<&CertificateDer<'static>> {
        self.connection.peer_certificates()?.first()
    }

    /// Reads what the peer has sent; 0 after its close_notify. An end without one is an error, since the stream may have been truncated.
    /// Dropping the future loses nothing.
    pub(crate) async fn read(&mut self, io: &mut Socket, into: &mut [u8]) -> io::Result<usize> {
        loop {
            match self.connection.reader().read(into) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                done => return done,
            }
            self.receive(io).await?;
        }
    }

    /// Writes some of `from`. What was taken of it is sent later if the future is dropped.
    pub(crate) async fn write(&mut self, io: &mut Socket, from: &[u8]) -> io::Result<usize> {
        self.flush(io).await?;
        let count = self.connection.writer().write(from)?;
        self.flush(io).await?;
        Ok(count)
    }

    /// Tells the peer that nothing follows.
    pub(crate) async fn close(&mut self, io: &mut Socket) -> io::Result<()> {
        self.connection.send_close_notify();
        self.flush(io).await
    }

    /// Reads from the socket once; 0 at its end.
    async fn receive(&mut self, io: &mut Socket) -> io::Result<usize> {
        let received = self.received.as_mut_slice();
        let count = io.read_stream(received).await?;
        let mut rest = self.received.get(..count).unwrap_or_default();
        loop {
            // Nothing at all tells of the end.
            self.connection.read_tls(&mut rest)?;
            if let Err(error) = self.connection.process_new_packets() {
                // The alert that tells why.
                let _ = self.flush(io).await;
                return Err(io::Error::new(io::ErrorKind::InvalidData, error));
            }
            if rest.is_empty() {
                break;
            }
        }
        // Responses of TLS itself.
        self.flush(io).await?;
        Ok(count)
    }

    async fn flush(&mut self, io: &mut Socket) -> io::Result<()> {
        while self.connection.wants_write() {
            io.write_with(|mut stream| self.connection.write_tls(&mut stream)).await?;
        }
        Ok(())
    }
}
