//! A Modbus master on a serial line, written from the specification and not from the gateway's codecs.

use embassy_time::{Duration, with_timeout};
use embedded_io_async::Write;
use mobgate::settings::Framing;

use crate::client::{Reply, Response};
use crate::framing::{self, Listener};
use crate::timing;
use crate::wire::{Heard, LineEnd};

/// A master. It keeps no silence by itself, except that it hears a frame's end by the silence behind it.
pub struct Master {
    line: LineEnd,
    listener: Listener,
    framing: Framing,
    patience: Duration,
}

impl Master {
    /// A master at `line` that waits a second for a response.
    pub fn new(line: LineEnd, framing: Framing) -> Self {
        let listener = Listener::new(line.clone(), framing);
        Self { line, listener, framing, patience: Duration::from_secs(1) }
    }

    /// The master with another patience.
    #[must_use]
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }

    /// Asks `unit` and waits for what comes; a frame that is corrupt is [`Response::Wrong`] without a PDU.
    pub async fn request(&mut self, unit: u8, pdu: &[u8]) -> Response {
        self.send(unit, pdu).await;
        let Some(heard) = self.receive().await else { return Response::Silence };
        let (from, response) = framing::open(self.framing, &heard.bytes).unwrap_or_default();
        let fits = response.first().map(|function| function & 0x7f) == pdu.first().copied();
        if from == unit && fits {
            return Response::Pdu(response);
        }
        Response::Wrong(Reply { transaction: 0, protocol: 0, unit: from, pdu: response })
    }

    /// Sends a request and is ready when it has left.
    pub async fn send(&mut self, unit: u8, pdu: &[u8]) {
        self.send_bytes(&framing::frame(self.framing, unit, pdu)).await;
    }

    /// Sends `bytes` as they are.
    pub async fn send_bytes(&mut self, bytes: &[u8]) {
        // Nobody to tell: a master that is not plugged in is not heard.
        let _ = self.line.write_all(bytes).await;
        let _ = self.line.flush().await;
    }

    /// The next frame, within the master's patience.
    pub async fn receive(&mut self) -> Option<Heard> {
        // A frame that has begun in time is heard to its end.
        let longest = Duration::from_nanos(timing::chars_ns(&self.line.line(), 513));
        with_timeout(self.patience + longest, self.listener.hear()).await.ok()
    }
}
