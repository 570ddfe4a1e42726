//! Clients that speak Modbus TCP, or RTU over TCP, written from the specification and not from the gateway's codecs.
//!
//! [`Client::request`] does one transaction; [`Client::send`] and [`Client::receive`] keep several open. [`load`] has clients that
//! ask again and again and note how long each response took; a [`session`] sends and receives independently.

use embassy_time::{Duration, with_timeout};
use embedded_io_async::{Read, Write};

use crate::device;
use crate::net::ClientStream;

pub mod load;
mod reply;
mod rtu;
pub mod session;
#[cfg(test)]
mod tests;

pub use reply::Reply;

/// MBAP header: transaction, protocol, length, unit.
const HEADER_BYTES: usize = 7;
/// The largest frame, Messaging on TCP/IP 3.1.3.
const FRAME_BYTES_MAX: usize = 260;

/// What came of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Response {
    /// A response or an exception: its PDU.
    Pdu(Vec<u8>),
    /// Nothing within the client's patience.
    Silence,
    /// The connection has ended.
    Closed,
    /// Something that is no response to this request.
    Wrong(Reply),
}

impl Response {
    /// The exception code, if it is an exception.
    pub fn exception(&self) -> Option<u8> {
        match self {
            Self::Pdu(pdu) => match pdu[..] {
                [function, code] if function & 0x80 != 0 => Some(code),
                _ => None,
            },
            _ => None,
        }
    }
}

/// Why [`Client::receive`] has no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoResponse {
    /// Nothing within the client's patience.
    Silence,
    /// The connection has ended.
    Closed,
}

/// A connected client.
pub struct Client {
    stream: ClientStream,
    patience: Duration,
    /// It speaks RTU, whose frames bear no transaction id: they have 0.
    is_rtu: bool,
    transaction: u16,
    received: Vec<u8>,
}

/// The frame of a request.
pub fn frame(transaction: u16, unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut frame = transaction.to_be_bytes().to_vec();
    frame.extend([0, 0]);
    frame.extend((pdu.len() as u16 + 1).to_be_bytes());
    frame.push(unit);
    frame.extend(pdu);
    frame
}

/// Takes the first frame off `received`, when all of it is there.
///
/// # Panics
/// When the gateway sent a length that no frame has: the stream cannot be understood any more.
pub(crate) fn take_frame(received: &mut Vec<u8>) -> Option<Reply> {
    let word = |at: usize| Some(u16::from_be_bytes([*received.get(at)?, *received.get(at + 1)?]));
    let (transaction, protocol, length) = (word(0)?, word(2)?, word(4)?);
    let end = HEADER_BYTES - 1 + usize::from(length);
    assert!((HEADER_BYTES..=FRAME_BYTES_MAX).contains(&end), "the gateway sent an MBAP length of {length}");
    if received.len() < end {
        return None;
    }
    let frame: Vec<u8> = received.drain(..end).collect();
    Some(Reply { transaction, protocol, unit: frame[6], pdu: frame[HEADER_BYTES..].to_vec() })
}

impl Client {
    /// A client on `stream` that waits 10 s for a response.
    pub fn new(stream: ClientStream) -> Self {
        let patience = Duration::from_secs(10);
        Self { stream, patience, is_rtu: false, transaction: 0, received: Vec::new() }
    }

    /// The same by RTU over TCP.
    pub fn rtu(stream: ClientStream) -> Self {
        Self { is_rtu: true, ..Self::new(stream) }
    }

    /// The client with another patience.
    #[must_use]
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    /// Asks `unit` and waits for the response.
    pub async fn request(&mut self, unit: u8, pdu: &[u8]) -> Response {
        match self.send(unit, pdu).await {
            Some(transaction) => self.response(transaction, unit, pdu).await,
            None => Response::Closed,
        }
    }

    /// The response to a request for `unit` that was sent.
    pub async fn response(&mut self, transaction: u16, unit: u8, pdu: &[u8]) -> Response {
        match self.receive().await {
            Ok(reply) if Self::fits(&reply, transaction, unit, pdu) => Response::Pdu(reply.pdu),
            Ok(reply) => Response::Wrong(reply),
            Err(NoResponse::Silence) => Response::Silence,
            Err(NoResponse::Closed) => Response::Closed,
        }
    }

    fn fits(reply: &Reply, transaction: u16, unit: u8, pdu: &[u8]) -> bool {
        let function = reply.pdu.first().map(|function| function & 0x7f);
        (reply.transaction, reply.protocol, reply.unit) == (transaction, 0, unit)
            && function == pdu.first().copied()
    }

    /// Sends a request without waiting for its response; its transaction id, or nothing when the connection has ended.
    pub async fn send(&mut self, unit: u8, pdu: &[u8]) -> Option<u16> {
        let frame = if self.is_rtu {
            device::rtu::frame(unit, pdu)
        } else {
            self.transaction = self.transaction.wrapping_add(1);
            frame(self.transaction, unit, pdu)
        };
        self.send_bytes(&frame).await.then_some(self.transaction)
    }

    /// Sends `bytes` as they are; false when the connection has ended.
    pub async fn send_bytes(&mut self, bytes: &[u8]) -> bool {
        self.stream.write_all(bytes).await.is_ok()
    }

    /// The next frame, whatever request it responds to.
    pub async fn receive(&mut self) -> Result<Reply, NoResponse> {
        let patience = self.patience;
        with_timeout(patience, self.receive_patiently()).await.unwrap_or(Err(NoResponse::Silence))
    }

    async fn receive_patiently(&mut self) -> Result<Reply, NoResponse> {
        let take = if self.is_rtu { rtu::take_frame } else { take_frame };
        loop {
            if let Some(reply) = take(&mut self.received) {
                return Ok(reply);
            }
            let mut buffer = [0; FRAME_BYTES_MAX];
            match self.stream.read(&mut buffer).await {
                Ok(0) | Err(_) => return Err(NoResponse::Closed),
                Ok(count) => self.received.extend_from_slice(&buffer[..count]),
            }
        }
    }

    /// Waits until the gateway ends the connection; false when it does not within the client's patience, or sends something.
    pub async fn is_closed(&mut self) -> bool {
        self.receive().await == Err(NoResponse::Closed)
    }

    /// The connection, to end it in one of its ways.
    pub fn into_stream(self) -> ClientStream {
        self.stream
    }
}
