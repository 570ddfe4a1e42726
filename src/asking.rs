//! What a console asks a unit at a port, past the rules: one request at a time, answered as any other.
//!
//! A console may also try other settings at a serial client's line: the port is started again with them, in its own task, and
//! again with its own as soon as the console has done, whatever ended it.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU16, Ordering};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::{Duration, Instant, Timer, with_deadline};

use crate::config::{LineSettings, PortId, PortKind, SerialClientSettings, Side};
use crate::frame::{Channel, Envelope, Frame, Origin, Stage, Way};
use crate::gateway::{Gateway, Status};
use crate::hal::{OpenError, OpenErrorKind};
use crate::modbus::Exception;
use crate::port::bus::Failure;
use crate::scanner::Pdu;

/// A request that has not been sent by then is not sent any more.
const LIFETIME: Duration = Duration::from_secs(10);

/// Longest wait: the port may become another one just then, and its slowest unit is not slower.
const PATIENCE: Duration = Duration::from_secs(120);

/// How often a console looks for a free frame, and how long.
const FRAME_PAUSE: Duration = Duration::from_millis(10);
const FRAME_PATIENCE: Duration = Duration::from_secs(1);

/// How often a console looks whether a line is open with the settings that it tries, and how long.
const OPENING_LOOK: Duration = Duration::from_millis(1);
const OPENING_PATIENCE: Duration = Duration::from_secs(3);

/// What a serial line brought for a request: the time from the request's end to the answer's, or what came instead.
pub(crate) type Outcome = Result<Duration, Failure>;

/// The way back to the console that asks, and what it tries.
pub(crate) struct Asking {
    pub(crate) answers: Channel,
    generation: AtomicU16,
    taken: AtomicBool,
    trial: Mutex<CriticalSectionRawMutex, Cell<Option<Trial>>>,
    /// What came of the last request, if it went on a serial line.
    outcome: Mutex<CriticalSectionRawMutex, Cell<Option<Outcome>>>,
}

/// Other settings of a serial client's line for a while.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trial {
    /// The port.
    pub(crate) port: PortId,
    /// Instead of the port's own.
    pub(crate) line: LineSettings,
    /// Instead of the port's own.
    pub(crate) timeout: Duration,
    /// Whether all others are refused at once, and the port forgets what it learns of its units.
    pub(crate) alone: bool,
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
        Self {
            answers: Channel::new(),
            generation: AtomicU16::new(0),
            taken: AtomicBool::new(false),
            trial: Mutex::new(Cell::new(None)),
            outcome: Mutex::new(Cell::new(None)),
        }
    }

    /// Whether somebody waits for the answer to request number `generation`.
    pub(crate) fn waits_for(&self, generation: u16) -> bool {
        self.taken.load(Ordering::Relaxed) && self.generation.load(Ordering::Relaxed) == generation
    }

    /// Notes what came of a request on a serial line.
    pub(crate) fn note(&self, outcome: Outcome) {
        self.outcome.lock(|last| last.set(Some(outcome)));
    }

    /// Puts what is tried at the port `id` into its settings; says whether all others are refused meanwhile.
    pub(crate) fn try_on(&self, id: PortId, kind: Option<&mut PortKind>) -> bool {
        let trial = self.trial.lock(Cell::get).filter(|trial| trial.port == id);
        let (Some(trial), Some(PortKind::Serial(serial))) = (trial, kind) else { return false };
        serial.line = trial.line;
        let start_delay = Duration::from_ticks(0);
        let (timeout, late_window) = (trial.timeout, None);
        serial.client = SerialClientSettings { timeout, late_window, start_delay, ..serial.client };
        trial.alone
    }
}

/// The console's turn to ask. When it ends, a port that it has tried something at gets its own settings back, and answers that
/// still come find nobody.
pub(crate) struct Turn<'t, 'g> {
    gateway: &'t Gateway<'g>,
    port: PortId,
}

impl Drop for Turn<'_, '_> {
    fn drop(&mut self) {
        let asking = &self.gateway.asking;
        if asking.trial.lock(|trial| trial.take()).is_some()
            && let Some(place) = self.gateway.ports().get(self.port.index())
        {
            place.changed.signal(());
        }
        asking.taken.store(false, Ordering::Relaxed);
    }
}

impl Turn<'_, '_> {
    /// Starts the port again with `line` and `timeout`, and waits until it is open.
    pub(crate) async fn try_on(
        &self,
        line: LineSettings,
        timeout: Duration,
        alone: bool,
    ) -> Result<(), OpenError> {
        let failed = OpenError::new(OpenErrorKind::Failed, "");
        let place = self.gateway.ports().get(self.port.index()).ok_or(failed)?;
        let trial = Trial { port: self.port, line, timeout, alone };
        self.gateway.asking.trial.lock(|cell| cell.set(Some(trial)));
        place.set_status(Status::Off);
        place.changed.signal(());
        let give_up = Instant::now() + OPENING_PATIENCE;
        loop {
            Timer::after(OPENING_LOOK).await;
            match place.status() {
                Status::Open => return Ok(()),
                Status::Failed(error) => return Err(error),
                _ if Instant::now() > give_up => return Err(failed),
                _ => {}
            }
        }
    }

    /// What came of the last request on a serial line; `None` when it was not sent.
    pub(crate) fn outcome(&self) -> Option<Outcome> {
        self.gateway.asking.outcome.lock(Cell::get)
    }

    /// Asks `unit` what `pdu` says, where its answer goes, and says how long that took. The port spares no unit that is down.
    pub(crate) async fn ask(&self, unit: u8, pdu: &mut Pdu) -> Result<Duration, NotAsked> {
        let Self { gateway, port } = *self;
        let generation = gateway.asking.generation.fetch_add(1, Ordering::Relaxed).wrapping_add(1);
        gateway.asking.outcome.lock(|last| last.set(None));
        let give_up = Instant::now() + FRAME_PATIENCE;
        let (origin, now) = (Origin { port, way: Way::Console, generation }, Instant::now());
        let asked = Envelope::request(origin, unit, now, now + LIFETIME);
        let asked = Envelope { destination: Some(port), paced: true, ..asked };
        // A request is no longer than a PDU may be.
        let frame = loop {
            match gateway.pool().fill(usize::MAX, pdu, asked) {
                Some(frame) => break frame,
                None if Instant::now() > give_up => return Err(NotAsked::NoFrame),
                None => Timer::after(FRAME_PAUSE).await,
            }
        };
        gateway.inbox.send(frame);
        loop {
            let answered = gateway.asking.answers.receive(gateway.pool());
            let answered = with_deadline(now + PATIENCE, answered).await.map_err(|_| NotAsked::Lost)?;
            let envelope = answered.envelope();
            if envelope.origin.generation != generation {
                continue;
            }
            pdu.clear();
            // It has room for every PDU.
            answered.pdu(|answer| pdu.extend_from_slice(answer).unwrap_or_default());
            return match envelope.stage {
                Stage::Answer => Ok(now.elapsed()),
                _ => Err(NotAsked::Broadcast),
            };
        }
    }
}

impl<'g> Gateway<'g> {
    /// The turn to ask units behind the client-side `port`.
    pub(crate) fn turn(&self, port: PortId) -> Result<Turn<'_, 'g>, NotAsked> {
        if self.settings(|settings| settings.port(port).is_none_or(|port| port.kind.side() == Side::Server)) {
            return Err(NotAsked::Server);
        }
        if self.asking.taken.swap(true, Ordering::Relaxed) {
            return Err(NotAsked::Taken);
        }
        Ok(Turn { gateway: self, port })
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
