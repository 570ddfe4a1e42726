//! The serial server's link to the gateway: which units are routed, and how requests are sent to the router.

use embassy_time::Instant;

use crate::frame::{Cause, Envelope, Frame, FrameWriter, Origin, ReplyTo};
use crate::gateway::{Gateway, PortState};
use crate::modbus::pdu;
use crate::routing;
use crate::routing::{Onward, onward};
use crate::settings::{PortId, SerialSettings};
use crate::stats::Event;

/// The port with its current settings.
pub(crate) struct Server<'s, 'g> {
    pub(crate) gateway: &'s Gateway<'g>,
    pub(crate) port_state: &'s PortState,
    pub(crate) id: PortId,
    pub(crate) settings: &'s SerialSettings,
    /// Whether the board's transmitters never underrun.
    pub(crate) never_underruns: bool,
}

impl<'g> Server<'_, 'g> {
    /// Drops responses that arrive from now on, as the line is closed.
    pub(crate) fn close(&self) {
        self.port_state.renew();
        self.port_state.queue.clear(self.gateway.pool());
    }

    pub(super) fn is_ours(&self, unit: u8) -> bool {
        self.gateway.settings(|settings| routing::is_routed(settings, self.id, unit))
    }

    /// Whether a request for `unit` that begins with `so_far` may be cut through.
    pub(super) fn onward(&self, unit: u8, so_far: &[u8]) -> Onward {
        self.gateway.settings(|settings| onward(settings, self.id, unit, so_far, self.never_underruns))
    }

    /// A frame for a request that is still arriving.
    pub(super) fn take_frame(&self) -> Option<(FrameWriter<'g>, Frame<'g>)> {
        self.gateway.take_for_port(self.id)
    }

    /// The envelope of the master's next request.
    pub(super) fn envelope(&self, unit: u8, received: Instant) -> Envelope {
        let generation = self.port_state.renew();
        let reply_to = if unit == 0 { ReplyTo::Nobody } else { ReplyTo::Line };
        let origin = Origin { port: self.id, reply_to, generation };
        Envelope::request(origin, unit, received, received + self.settings.server.answer_within)
    }

    /// Sends a request to the router; returns whether a response will come.
    pub(super) fn ask(&self, unit: u8, request: &[u8], received: Instant) -> bool {
        let cut = matches!(self.onward(unit, request), Onward::To(_));
        let envelope = Envelope { cut, ..self.envelope(unit, received) };
        // Fits: it is a frame's PDU.
        let Some(frame) = self.gateway.fill_for_port(self.id, request, envelope) else {
            self.port_state.stats.count(Event::BackPressure);
            return false;
        };
        self.port_state.stats.count(Event::Request);
        match pdu::check_request(request) {
            Ok(()) => self.gateway.inbox.send(frame),
            Err(exception) => {
                self.port_state.stats.count(Event::Refused);
                if pdu::is_beyond_response(request) {
                    frame.blame(Cause::Length);
                }
                self.gateway.refuse(frame, exception);
            }
        }
        unit != 0
    }
}
