//! A client that speaks RTU over TCP.

use embassy_time::{Duration, with_timeout};
use embedded_io_async::{Read, Write};

use super::{Answer, Reply};
use crate::device::rtu;
use crate::net::ClientStream;

/// A connected client.
pub struct RtuClient {
    stream: ClientStream,
    patience: Duration,
}

impl RtuClient {
    /// A client on `stream` that waits 10 s for a response.
    pub fn new(stream: ClientStream) -> Self {
        Self { stream, patience: Duration::from_secs(10) }
    }

    /// The client with another patience.
    #[must_use]
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    /// Asks `unit` and waits for the response.
    pub async fn request(&mut self, unit: u8, pdu: &[u8]) -> Answer {
        if self.send_bytes(&rtu::frame(unit, pdu)).await {
            self.answer(unit, pdu).await
        } else {
            Answer::Closed
        }
    }

    /// Sends `bytes` as they are; false when the connection has ended.
    pub async fn send_bytes(&mut self, bytes: &[u8]) -> bool {
        self.stream.write_all(bytes).await.is_ok()
    }

    /// The response to a request for `unit` that was sent: the first bytes with a good CRC.
    pub async fn answer(&mut self, unit: u8, pdu: &[u8]) -> Answer {
        let patience = self.patience;
        let received = with_timeout(patience, self.receive()).await;
        match received {
            Err(_) => Answer::Silence,
            Ok(None) => Answer::Closed,
            Ok(Some(reply)) if reply.unit == unit && reply.pdu[0] & 0x7f == pdu[0] => Answer::Pdu(reply.pdu),
            Ok(Some(reply)) => Answer::Wrong(reply),
        }
    }

    /// Byte by byte, so that of two frames in a row only the first is taken.
    async fn receive(&mut self) -> Option<Reply> {
        let mut received = Vec::new();
        loop {
            let mut byte = [0];
            match self.stream.read(&mut byte).await {
                Ok(1) => received.extend(byte),
                _ => return None,
            }
            if let Some(reply) = take_frame(&mut received) {
                return Some(reply);
            }
        }
    }

    /// The connection, to end it in one of its ways.
    pub fn into_stream(self) -> ClientStream {
        self.stream
    }
}

/// Takes the first whole frame off the front: the first bytes with a good CRC. It has no transaction id.
pub(super) fn take_frame(received: &mut Vec<u8>) -> Option<Reply> {
    let good = |end: &usize| rtu::open(&received[..*end]).is_some_and(|(_, pdu)| pdu.len() >= shortest(pdu));
    let end = (0..=received.len()).find(good)?;
    let frame: Vec<u8> = received.drain(..end).collect();
    rtu::open(&frame).map(|(unit, pdu)| Reply { transaction: 0, protocol: 0, unit, pdu: pdu.to_vec() })
}

/// Bytes that a response with this beginning has at least: the beginning of one may have a right CRC by chance.
fn shortest(pdu: &[u8]) -> usize {
    match *pdu {
        [1..=4 | 17 | 23, count, ..] => 2 + usize::from(count),
        [5 | 6 | 15 | 16, ..] => 5,
        [22, ..] => 7,
        _ => 2,
    }
}
