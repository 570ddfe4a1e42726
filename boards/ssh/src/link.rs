//! A connection below log-in: identification, packets, and what concerns all of them (RFC 4253).

use core::ops::Range;

use embedded_io_async::{Read, Write};
use heapless::Vec;
use salty::Keypair;
use zeroize::ZeroizeOnDrop;

use crate::Error;
use crate::packets::{Incoming, Outgoing};
use crate::wire::{Reader, Writer};

/// The server's identification.
pub(crate) const IDENTIFICATION: &str = "SSH-2.0-mobgate";
/// Longest identification of a client, with its line end (RFC 4253, 4.2).
const IDENTIFICATION_BYTES_MAX: usize = 255;

const DISCONNECT: u8 = 1;
const IGNORE: u8 = 2;
const UNIMPLEMENTED: u8 = 3;
const DEBUG: u8 = 4;
const EXTENSIONS: u8 = 7;
pub(crate) const EXCHANGE: u8 = 20;

/// Bytes of an exchange's hash (SHA-256).
pub(crate) const HASH_BYTES: usize = 32;

/// What the board gives to a connection.
#[derive(Clone, Copy)]
pub(crate) struct Secrets<'b> {
    pub(crate) host_key: &'b Keypair,
    /// Fills in random numbers; false if there are none.
    pub(crate) random: &'b dyn Fn(&mut [u8]) -> bool,
}

/// What stays the same when keys are exchanged again.
#[derive(ZeroizeOnDrop)]
pub(crate) struct Agreed {
    /// The session's number: the first exchange's hash.
    pub(crate) session: [u8; HASH_BYTES],
    /// Counters of packets begin anew with each exchange.
    pub(crate) strict: bool,
}

/// A connection.
pub(crate) struct Link<'b, S> {
    pub(crate) stream: S,
    pub(crate) incoming: Incoming,
    pub(crate) outgoing: Outgoing,
    pub(crate) secrets: Secrets<'b>,
    /// The client's identification.
    pub(crate) client: Vec<u8, IDENTIFICATION_BYTES_MAX>,
    /// The first key exchange's result; `None` before it.
    pub(crate) agreed: Option<Agreed>,
}

impl<'b, S: Read + Write> Link<'b, S> {
    pub(crate) fn new(stream: S, secrets: Secrets<'b>) -> Self {
        let (incoming, outgoing) = (Incoming::new(), Outgoing::new());
        Self { stream, incoming, outgoing, secrets, client: Vec::new(), agreed: None }
    }

    /// Exchanges identifications, then keys.
    pub(crate) async fn begin(&mut self) -> Result<(), Error> {
        let (own, end) = (IDENTIFICATION.as_bytes(), b"\r\n");
        self.stream.write_all(own).await.map_err(|_| Error::Closed)?;
        self.stream.write_all(end).await.map_err(|_| Error::Closed)?;
        loop {
            if let Some(line) = self.incoming.line(IDENTIFICATION_BYTES_MAX)? {
                if !line.starts_with(b"SSH-2.0-") {
                    return Err(Error::MALFORMED);
                }
                self.client = Vec::from_slice(line).map_err(|_| Error::MALFORMED)?;
                break;
            }
            self.incoming.fill(&mut self.stream).await?;
        }
        let offer = self.any().await?;
        self.exchange(offer).await
    }

    /// The next packet, whatever it is.
    pub(crate) async fn any(&mut self) -> Result<Range<usize>, Error> {
        loop {
            if let Some(payload) = self.incoming.next()? {
                return Ok(payload);
            }
            self.fill().await?;
        }
    }

    /// As [`Incoming::fill`].
    pub(crate) async fn fill(&mut self) -> Result<(), Error> {
        self.incoming.fill(&mut self.stream).await
    }

    /// The next packet that has arrived for the layers above, if any. Re-keys when the client asks for it.
    /// A pending future must not be dropped, unless the connection ends.
    pub(crate) async fn arrived(&mut self) -> Result<Option<Range<usize>>, Error> {
        while let Some(payload) = self.incoming.next()? {
            match self.incoming.payload(payload.clone()).first() {
                Some(&DISCONNECT) => return Err(Error::Closed),
                Some(&(IGNORE | UNIMPLEMENTED | DEBUG | EXTENSIONS)) => {}
                Some(&EXCHANGE) => self.exchange(payload).await?,
                _ => return Ok(Some(payload)),
            }
        }
        Ok(None)
    }

    /// Waits for the next packet for the layers above.
    pub(crate) async fn receive(&mut self) -> Result<Range<usize>, Error> {
        loop {
            if let Some(payload) = self.arrived().await? {
                return Ok(payload);
            }
            self.fill().await?;
        }
    }

    /// The fields of a packet behind the message's number, and that.
    pub(crate) fn read(&self, payload: Range<usize>) -> Result<(u8, Reader<'_>), Error> {
        let mut reader = Reader::new(self.incoming.payload(payload));
        Ok((reader.byte()?, reader))
    }

    /// Sends a message. A pending future must not be dropped, unless the connection ends.
    pub(crate) async fn send(
        &mut self,
        number: u8,
        write: impl FnOnce(&mut Writer<'_>),
    ) -> Result<(), Error> {
        self.outgoing.compose(number, write)?;
        self.outgoing.send(&mut self.stream).await
    }

    /// Sends SSH_MSG_UNIMPLEMENTED for the last packet (RFC 4253, 11.4).
    pub(crate) async fn unimplemented(&mut self) -> Result<(), Error> {
        let number = self.incoming.sequence().wrapping_sub(1);
        self.send(UNIMPLEMENTED, |message| _ = message.number(number)).await
    }

    /// Sends the reason for the end of the connection.
    pub(crate) async fn disconnect(&mut self, reason: u32) -> Result<(), Error> {
        self.send(DISCONNECT, |message| _ = message.number(reason).string(b"").string(b"")).await
    }
}
