//! A client's end of a TCP connection.

use embedded_io_async::{ErrorKind, ErrorType, Read, Write};

use super::pipe::Pipe;

/// A client's end of a connection. Dropping it closes it, as a program that ends does.
pub struct ClientStream {
    pub(super) incoming: Pipe,
    pub(super) outgoing: Pipe,
}

impl ClientStream {
    /// The receiving half, for a task that receives while another one sends. It does not keep the connection open.
    pub(crate) fn reader(&self) -> Pipe {
        self.incoming.clone()
    }

    /// Sends the FIN behind what was written, and goes on reading: a half-closed connection.
    pub fn finish(&mut self) {
        self.outgoing.finish();
    }

    /// Resets the connection: both directions are dead at once.
    pub fn reset(self) {
        self.outgoing.reset();
        self.incoming.reset();
    }

    /// Vanishes: the gateway hears nothing more, neither data nor FIN nor reset.
    pub fn vanish(self) {
        self.outgoing.go_silent();
        self.incoming.go_silent();
    }
}

impl Drop for ClientStream {
    fn drop(&mut self) {
        self.outgoing.finish();
        self.incoming.abandon();
    }
}

impl ErrorType for ClientStream {
    type Error = ErrorKind;
}

impl Read for ClientStream {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        self.incoming.read(into).await
    }
}

impl Write for ClientStream {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        self.outgoing.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}
