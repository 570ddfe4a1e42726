//! Which request is served next.

use embassy_time::Instant;

use super::{Desk, Proving, care, milliseconds};
use crate::frame::{Fill, Frame};
use crate::gateway::unit_health::{Gate, Ready, Step};
use crate::modbus::Exception;
use crate::port::client::queue::{BROADCAST, Next, PortQueue, Ticket};
use crate::port::client::servers::LINKS_MAX;
use crate::stats::Event;

impl<'g> Desk<'g> {
    /// Sends home what must not be sent any more.
    pub(super) fn sweep(&self) {
        let now = Instant::now();
        self.swept.set(milliseconds(now));
        let gate = self.gates(self.all_well(now));
        loop {
            let unwanted = self.queue().take_if(|frame, ticket| {
                if self.gateway.is_gone(frame.origin()) {
                    Some(Event::AskerGone)
                } else if ticket.deadline <= now {
                    Some(Event::Expired)
                } else if gate(ticket.unit) == Gate::Down && !frame.envelope().paced {
                    Some(Event::UnitDown)
                } else {
                    None
                }
            });
            match unwanted {
                Some((frame, event)) => self.fail(frame, event, Exception::GATEWAY_NO_RESPONSE),
                None => return self.count_waiting(),
            }
        }
    }

    /// The next order for `link`, which is being carried out from now on.
    pub(crate) fn next(&self, link: u8) -> Next<Frame<'g>> {
        let now = Instant::now();
        self.sweep_if_due(now);
        if LINKS_MAX > 1 && self.current().is_full() {
            return Next::Empty;
        }
        loop {
            // An order that was postponed has closed its unit's gate.
            let ready = self.readiness(now);
            let is_only = LINKS_MAX == 1 || self.servers().len() == 1;
            let is_here = |unit| is_only || self.servers().link(unit) == Some(link);
            let ready = |unit| if is_here(unit) { ready(unit) } else { Ready::Elsewhere };
            let next = self.queue().next(now, ready);
            let Next::Serve(frame, ticket) = next else {
                self.count_waiting();
                return next;
            };
            // Others whose askers have gone are found out when their turn comes, or the queue is full.
            if self.gateway.is_gone(frame.origin()) {
                self.fail(frame, Event::AskerGone, Exception::GATEWAY_NO_RESPONSE);
                continue;
            }
            let in_step = match self.step(&frame, &ticket, now) {
                Some(in_step) => in_step,
                None => {
                    self.postpone(frame);
                    continue;
                }
            };
            let current = frame.share_for(self.start(&frame, &ticket, in_step, now));
            // There is room: a port has at most as many orders open, and one that is not kept here is in its hands alone.
            let _ = self.current().push(current);
            self.count_waiting();
            return Next::Serve(frame, ticket);
        }
    }

    /// Sends home what must not be sent any more, if there may be something.
    pub(super) fn sweep_if_due(&self, now: Instant) {
        if !self.all_well(now) || self.queue().first_deadline().is_some_and(|deadline| deadline <= now) {
            self.sweep();
        }
    }

    /// Says of each unit when it may be asked.
    pub(super) fn readiness(&self, now: Instant) -> impl Fn(u8) -> Ready {
        let gate = self.gates(self.all_well(now));
        move |unit| match gate(unit) {
            Gate::Open(ready) => ready,
            // Only an asker who is not kept from it has an order here.
            Gate::Down => self.place.units(|units| units.attempt(unit, now)),
        }
    }

    /// Whether the unit that `frame` is for is in step, so that it may share its transaction and be passed on while it arrives. None
    /// when it must not be sent now. Notes what is to be sent before it.
    pub(super) fn step(&self, frame: &Frame<'g>, ticket: &Ticket, now: Instant) -> Option<bool> {
        let unit = ticket.unit;
        self.set_proof(unit, None);
        if self.transaction_ids || unit == BROADCAST {
            return Some(true);
        }
        self.place.units(|units| {
            if units.is_in_step(unit, false) {
                return Some(true);
            }
            if frame.filled().1 == Fill::Filling {
                return None;
            }
            let care = self.gateway.settings(|settings| care(&settings.port(self.id)?.kind, unit))?;
            let step = frame.pdu(|request| Some(units.step(unit, request, &care, now)))?;
            match step {
                Step::Direct => {}
                Step::Prove(request, purpose) => self.set_proof(unit, Some(Proving { request, purpose })),
                Step::Wait => return None,
            }
            Some(false)
        })
    }

    /// `frame` waits on. One that still arrives comes again when it is whole.
    pub(super) fn postpone(&self, frame: Frame<'g>) {
        if !frame.abandon() {
            let envelope = frame.envelope();
            self.enqueue(frame, &envelope, PortQueue::put_back);
        }
    }

    /// Whether no unit has to be looked at by itself.
    pub(super) fn all_well(&self, now: Instant) -> bool {
        self.place.units(|units| units.all_well(now))
    }

    /// Says of each unit whether it may be asked. Mostly all are well.
    pub(super) fn gates(&self, all_well: bool) -> impl Fn(u8) -> Gate {
        move |unit| if all_well { Gate::Open(Ready::Now) } else { self.gate(unit) }
    }

    pub(super) fn gate(&self, unit: u8) -> Gate {
        let gate = self.place.units(|units| {
            if !units.troubled() {
                return Some(Gate::Open(Ready::Now));
            }
            match units.gate(unit, Instant::now()) {
                Gate::Open(_) if units.is_down(unit) => None,
                gate => Some(gate),
            }
        });
        // A unit that is down gets one probe at a time.
        let probed = || self.current().iter().any(|order| order.target() == unit);
        gate.unwrap_or_else(|| if probed() { Gate::Down } else { Gate::Open(Ready::Now) })
    }
}
