//! Direct requests: a console's requests to a unit behind a port, past the rules. One at a time, served like any other.
//!
//! A console may also try other line settings on a serial client: its port restarts with them, and restarts with its own once the
//! console is done, for whatever reason.

use core::cell::Cell;
use core::sync::atomic::Ordering;

use embassy_time::{Duration, Instant, Timer, with_deadline};

use crate::frame::{Envelope, Origin, ReplyTo, Stage};
use crate::gateway::{Gateway, Status};
use crate::hal::{OpenError, OpenErrorKind};
use crate::scanner::Pdu;
use crate::settings::{LineSettings, PortId, Side};

mod state;

use self::state::Trial;
pub(crate) use self::state::{DirectRequestState, Failure, Outcome};

/// A request still unsent after this is dropped.
const LIFETIME: Duration = Duration::from_secs(10);

/// Longest wait for a response: as long as the largest response time-out allowed, in case the port has just been reconfigured.
const PATIENCE: Duration = Duration::from_secs(120);

/// How often a console tries to get a free frame, and for how long.
const FRAME_PAUSE: Duration = Duration::from_millis(10);
const FRAME_PATIENCE: Duration = Duration::from_secs(1);

/// How often a console checks whether a line with trial settings is open, and for how long.
const OPENING_POLL: Duration = Duration::from_millis(1);
const OPENING_PATIENCE: Duration = Duration::from_secs(3);

/// Why there is no response, or no request was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum DirectRequestError {
    #[error("another console is sending a request")]
    Taken,
    #[error("no frame is free")]
    NoFrame,
    #[error("the port is a server: use a client port")]
    Server,
    #[error("no response")]
    Lost,
    #[error("broadcast sent; there is no response")]
    Broadcast,
}

/// A console's exclusive use of direct requests. Dropping it restores the settings of a port on trial, and drops responses that
/// still arrive.
pub(crate) struct Turn<'t, 'g> {
    gateway: &'t Gateway<'g>,
    port: PortId,
}

impl Drop for Turn<'_, '_> {
    fn drop(&mut self) {
        let state = &self.gateway.direct_request;
        if state.trial.lock(|trial| trial.take()).is_some()
            && let Some(port_state) = self.gateway.ports().get(self.port.index())
        {
            port_state.changed.signal(());
        }
        state.taken.store(false, Ordering::Relaxed);
    }
}

impl Turn<'_, '_> {
    /// Restarts the port with `line` and `timeout`, and waits until it is open.
    pub(crate) async fn try_on(
        &self,
        line: LineSettings,
        timeout: Duration,
        alone: bool,
    ) -> Result<(), OpenError> {
        let failed = OpenError::new(OpenErrorKind::Failed, "");
        let port_state = self.gateway.ports().get(self.port.index()).ok_or(failed)?;
        let trial = Trial { port: self.port, line, timeout, alone };
        self.gateway.direct_request.trial.lock(|cell| cell.set(Some(trial)));
        port_state.set_status(Status::Off);
        port_state.changed.signal(());
        let give_up = Instant::now() + OPENING_PATIENCE;
        loop {
            Timer::after(OPENING_POLL).await;
            match port_state.status() {
                Status::Open => return Ok(()),
                Status::Failed(error) => return Err(error),
                _ if Instant::now() > give_up => return Err(failed),
                _ => {}
            }
        }
    }

    /// The outcome of the last request on a serial line; `None` if it was not sent.
    pub(crate) fn outcome(&self) -> Option<Outcome> {
        self.gateway.direct_request.outcome.lock(Cell::get)
    }

    /// Sends `pdu` to `unit`, replaces it by the response, and returns the time that took. Also asks a unit that is down.
    pub(crate) async fn ask(&self, unit: u8, pdu: &mut Pdu) -> Result<Duration, DirectRequestError> {
        let Self { gateway, port } = *self;
        let generation = gateway.direct_request.generation.fetch_add(1, Ordering::Relaxed).wrapping_add(1);
        gateway.direct_request.outcome.lock(|last| last.set(None));
        let give_up = Instant::now() + FRAME_PATIENCE;
        let (origin, now) = (Origin { port, reply_to: ReplyTo::Console, generation }, Instant::now());
        let asked = Envelope::request(origin, unit, now, now + LIFETIME);
        let asked = Envelope { destination: Some(port), paced: true, ..asked };
        // Fits: no longer than a PDU may be.
        let frame = loop {
            match gateway.pool().fill(usize::MAX, pdu, asked) {
                Some(frame) => break frame,
                None if Instant::now() > give_up => return Err(DirectRequestError::NoFrame),
                None => Timer::after(FRAME_PAUSE).await,
            }
        };
        gateway.inbox.send(frame);
        loop {
            let answered = gateway.direct_request.responses.receive(gateway.pool());
            let answered =
                with_deadline(now + PATIENCE, answered).await.map_err(|_| DirectRequestError::Lost)?;
            let envelope = answered.envelope();
            if envelope.origin.generation != generation {
                continue;
            }
            pdu.clear();
            // Fits: sized for any PDU.
            answered.pdu(|response| pdu.extend_from_slice(response).unwrap_or_default());
            return match envelope.stage {
                Stage::Response => Ok(now.elapsed()),
                _ => Err(DirectRequestError::Broadcast),
            };
        }
    }
}

impl<'g> Gateway<'g> {
    /// Claims direct requests to units behind the client-side `port`.
    pub(crate) fn turn(&self, port: PortId) -> Result<Turn<'_, 'g>, DirectRequestError> {
        if self.settings(|settings| settings.port(port).is_none_or(|port| port.kind.side() == Side::Server)) {
            return Err(DirectRequestError::Server);
        }
        if self.direct_request.taken.swap(true, Ordering::Relaxed) {
            return Err(DirectRequestError::Taken);
        }
        Ok(Turn { gateway: self, port })
    }
}
