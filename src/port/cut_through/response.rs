//! Receives the response to a request into the request's frame, either when it is complete or while it arrives.

use embassy_time::Instant;

use crate::frame::Frame;
use crate::modbus::pdu::{self, End};
use crate::port::client::dispatcher::{Dispatcher, is_responding};
use crate::port::cut_through::ingress::{Ingress, Passing, is_whole};
use crate::settings::Lane;

/// The expected response.
pub(crate) struct IncomingResponse<'r, 'g> {
    dispatcher: &'r Dispatcher<'g>,
    frame: &'r Frame<'g>,
    unit: u8,
    request: &'r [u8],
    /// The response belongs to a proof sent ahead of the request.
    is_proof: bool,
    /// The requester's line, if cut-through is possible.
    requester: Option<Lane>,
    passing: Passing<'g>,
}

impl<'r, 'g> IncomingResponse<'r, 'g> {
    pub(crate) fn new(
        dispatcher: &'r Dispatcher<'g>,
        frame: &'r Frame<'g>,
        unit: u8,
        request: &'r [u8],
    ) -> Self {
        let (cut, origin) = frame.read(|envelope| (envelope.cut, envelope.origin));
        // A response cannot be stored any more once its forwarding has begun, so its length must be known in time.
        let has_end = || pdu::response_end(request, request.get(..1).unwrap_or(&[])) != End::Unknown;
        let lane = || dispatcher.gateway().settings(|settings| Lane::at(settings, origin.port));
        let in_step = || dispatcher.port_state().units(|units| units.is_in_step(unit, true));
        let is_proof = dispatcher.is_proving(frame);
        let requester = if cut && !is_proof && has_end() && in_step() { lane() } else { None };
        Self { dispatcher, frame, unit, request, is_proof, requester, passing: Passing::Open }
    }

    /// The unit asked.
    pub(crate) fn unit(&self) -> u8 {
        self.unit
    }

    /// The request's PDU.
    pub(crate) fn request(&self) -> &'r [u8] {
        self.request
    }

    /// Whether the response may be cut through.
    pub(crate) fn is_passed_on(&self) -> bool {
        self.requester.is_some()
    }

    /// When to act even if nothing arrives.
    pub(crate) fn due(&self) -> Instant {
        self.passing.due()
    }

    /// Handles the start of an ASCII frame, whatever state the previous one was in; `may_pass`: it may be cut through.
    pub(crate) fn begin(&mut self, may_pass: bool) {
        self.passing = if may_pass { Passing::Open } else { Passing::Whole };
    }

    /// Examines the bytes `received` of a frame that began at `begun` on `line`, and forwards them when due.
    pub(crate) fn feed(&mut self, received: &[u8], begun: Instant, line: &Lane) {
        let (Some(requester), Some((&unit, so_far))) = (self.requester, received.split_first()) else {
            return;
        };
        let end = pdu::response_end(self.request, so_far);
        match &mut self.passing {
            Passing::Whole => return,
            Passing::Begun(arriving) => {
                if !arriving.take(received, end) {
                    self.passing = Passing::Whole;
                }
                return;
            }
            Passing::Open | Passing::At(_) if unit != self.unit || is_responding(self.frame) => {
                self.passing = Passing::Whole;
            }
            Passing::Open | Passing::At(_) => self.passing = Passing::plan(begun, line, &requester, end),
        }
        if self.passing.is_due() {
            let mut arriving = Ingress::new(self.frame.rewrite(), line.framing);
            arriving.take(received, end);
            self.passing = Passing::Begun(arriving);
            self.dispatcher.responding(self.frame);
        }
    }

    /// Handles the complete response `pdu`; while it is being forwarded, `received` holds it right after the unit.
    pub(crate) fn whole(&mut self, received: &[u8], pdu: &[u8]) {
        match core::mem::replace(&mut self.passing, Passing::Whole) {
            // Its frame may have been given up meanwhile.
            Passing::Begun(arriving)
                if received.get(1..=pdu.len()).is_some_and(|begin| core::ptr::eq(begin, pdu)) =>
            {
                arriving.finish(pdu);
            }
            Passing::Begun(_) => {}
            // Fits: no longer than a PDU may be.
            _ if !self.is_proof && !is_responding(self.frame) => {
                let _ = self.frame.replace(pdu);
            }
            _ => {}
        }
    }

    /// Handles that `received` is not the response so far; `silent`: nothing more of it follows.
    pub(crate) fn not_yet(&mut self, received: &[u8], silent: bool) {
        let end = received.split_first().map(|(_, so_far)| (so_far, pdu::response_end(self.request, so_far)));
        match core::mem::replace(&mut self.passing, Passing::Whole) {
            Passing::Begun(arriving) => match end {
                Some((so_far, end)) if is_whole(so_far, end) => {}
                _ if silent => {}
                _ => self.passing = Passing::Begun(arriving),
            },
            _ if silent => self.passing = Passing::Open,
            passing => self.passing = passing,
        }
    }
}
