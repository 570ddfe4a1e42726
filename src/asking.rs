//! What a console asks a unit at a port, past the rules: one request at a time, answered as any other.

use core::sync::atomic::{AtomicBool, AtomicU16, Ordering};

use embassy_time::{Duration, Instant, with_deadline};

use crate::config::{PortId, Side};
use crate::frame::{Channel, Envelope, Frame, Origin, Stage, Way};
use crate::gateway::Gateway;
use crate::modbus::{Exception, PDU_BYTES_MAX};
use crate::scanner::Pdu;

/// A request that has not been sent by then is not sent any more.
const LIFETIME: Duration = Duration::from_secs(10);

/// Longest wait: the port may become another one just then, and its slowest unit is not slower.
const PATIENCE: Duration = Duration::from_secs(120);

/// The way back to the console that asks.
pub(crate) struct Asking {
    pub(crate) answers: Channel,
    generation: AtomicU16,
    taken: AtomicBool,
}

/// Why nothing was asked, or nothing came back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum NotAsked {
    #[error("another console is asking")]
    Taken,
    #[error("no frame is free")]
    NoFrame,
    #[error("the port is a server: ask via a client's port")]
    Server,
    #[error("nothing came back")]
    Lost,
    #[error("sent to everybody; nobody answers")]
    Broadcast,
}

impl Asking {
    pub(crate) const fn new() -> Self {
        Self { answers: Channel::new(), generation: AtomicU16::new(0), taken: AtomicBool::new(false) }
    }

    /// Whether somebody waits for the answer to request number `generation`.
    pub(crate) fn waits_for(&self, generation: u16) -> bool {
        self.taken.load(Ordering::Relaxed) && self.generation.load(Ordering::Relaxed) == generation
    }
}

/// The console that asks; answers that come when it has gone find nobody.
struct Turn<'a>(&'a Asking);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.taken.store(false, Ordering::Relaxed);
    }
}

impl Gateway<'_> {
    /// The answer of `unit` behind the client-side `port` to `request`, and how long it took. The port spares no unit that is down.
    pub(crate) async fn ask(
        &self,
        port: PortId,
        unit: u8,
        request: &[u8],
    ) -> Result<(Pdu, Duration), NotAsked> {
        if self.settings(|settings| settings.port(port).is_none_or(|port| port.kind.side() == Side::Server)) {
            return Err(NotAsked::Server);
        }
        if self.asking.taken.swap(true, Ordering::Relaxed) {
            return Err(NotAsked::Taken);
        }
        let turn = Turn(&self.asking);
        let generation = turn.0.generation.fetch_add(1, Ordering::Relaxed).wrapping_add(1);
        let (origin, now) = (Origin { port, way: Way::Console, generation }, Instant::now());
        let asked = Envelope::request(origin, unit, now, now + LIFETIME);
        let asked = Envelope { destination: Some(port), paced: true, ..asked };
        // A request is no longer than a PDU may be.
        let frame = self.pool().fill(usize::MAX, request, asked).ok_or(NotAsked::NoFrame)?;
        self.inbox.send(frame);
        loop {
            let answer = turn.0.answers.receive(self.pool());
            let answer = with_deadline(now + PATIENCE, answer).await.map_err(|_| NotAsked::Lost)?;
            let envelope = answer.envelope();
            if envelope.origin.generation != generation {
                continue;
            }
            let mut pdu = [0; PDU_BYTES_MAX];
            let length = answer.copy_pdu(&mut pdu);
            let pdu = pdu.get(..length).and_then(|pdu| Pdu::from_slice(pdu).ok());
            return match (envelope.stage, pdu) {
                (Stage::Answer, Some(pdu)) => Ok((pdu, now.elapsed())),
                _ => Err(NotAsked::Broadcast),
            };
        }
    }

    /// Sends what a console asks to the port that it named.
    pub(crate) fn forward_asked(&self, frame: Frame<'_>) {
        let port = frame.envelope().destination;
        match port.and_then(|port| self.ports().get(port.index())) {
            Some(place) => place.queue.send(frame),
            None => self.refuse(frame, Exception::GATEWAY_NO_PATH),
        }
    }
}
