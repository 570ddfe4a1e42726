//! Selects the next request to send.

use embassy_time::Instant;

use super::{Dispatcher, Proving, care, milliseconds};
use crate::frame::{Fill, Frame};
use crate::gateway::unit_health::{Gate, Ready, Step};
use crate::modbus::Exception;
use crate::port::client::queue::{BROADCAST, Entry, Next, PortQueue};
use crate::port::client::servers::CONNECTIONS_MAX;
use crate::stats::Event;

impl<'g> Dispatcher<'g> {
    /// Drops requests that expired or were abandoned, and those for units that are down.
    pub(super) fn sweep(&self) {
        let now = Instant::now();
        self.swept.set(milliseconds(now));
        let gate = self.gates(self.all_healthy(now));
        loop {
            let unwanted = self.queue().take_if(|frame, entry| {
                if self.gateway.is_gone(frame.origin()) {
                    Some(Event::RequesterGone)
                } else if entry.deadline <= now {
                    Some(Event::Expired)
                } else if gate(entry.unit) == Gate::Down && !frame.read(|envelope| envelope.paced) {
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

    /// The next request for `connection`; it counts as in flight from now on.
    pub(crate) fn next(&self, connection: u8) -> Next<Frame<'g>> {
        let now = Instant::now();
        self.sweep_if_due(now);
        if CONNECTIONS_MAX > 1 && self.current().is_full() {
            return Next::Empty;
        }
        loop {
            // Computed in each round: postponing a request closes its unit's gate.
            let ready = self.readiness(now);
            let is_only = CONNECTIONS_MAX == 1 || self.servers().len() == 1;
            let is_here = |unit| is_only || self.servers().connection(unit) == Some(connection);
            let ready = |unit| if is_here(unit) { ready(unit) } else { Ready::Elsewhere };
            let next = self.queue().next(now, ready);
            let Next::Serve(frame, entry) = next else {
                self.count_waiting();
                return next;
            };
            // Other abandoned requests are dropped at their turn, or when the queue is full.
            if self.gateway.is_gone(frame.origin()) {
                self.fail(frame, Event::RequesterGone, Exception::GATEWAY_NO_RESPONSE);
                continue;
            }
            let in_step = match self.step(&frame, &entry, now) {
                Some(in_step) => in_step,
                None => {
                    self.postpone(frame);
                    continue;
                }
            };
            let current = frame.share_for(self.start(&frame, &entry, in_step, now));
            // Within the capacity: a port never has more requests in flight. Were it full, the caller would still hold the request.
            let _ = self.current().push(current);
            self.count_waiting();
            return Next::Serve(frame, entry);
        }
    }

    /// Sweeps if a request may have expired or a unit may be down.
    pub(super) fn sweep_if_due(&self, now: Instant) {
        if !self.all_healthy(now) || self.queue().first_deadline().is_some_and(|deadline| deadline <= now) {
            self.sweep();
        }
    }

    /// When each unit may be asked.
    pub(super) fn readiness(&self, now: Instant) -> impl Fn(u8) -> Ready {
        let gate = self.gates(self.all_healthy(now));
        move |unit| match gate(unit) {
            Gate::Open(ready) => ready,
            // Only requesters with their own back-off have requests queued for a unit that is down.
            Gate::Down => self.port_state.units(|units| units.attempt(unit, now)),
        }
    }

    /// Whether the unit of `frame` is in step, so that its transaction may be shared and cut through; `None` if it must wait.
    /// Sets the proof to send first, if one is needed.
    pub(super) fn step(&self, frame: &Frame<'g>, entry: &Entry, now: Instant) -> Option<bool> {
        let unit = entry.unit;
        self.set_proof(unit, None);
        if self.transaction_ids || unit == BROADCAST {
            return Some(true);
        }
        self.port_state.units(|units| {
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

    /// Requeues `frame`. One that is still arriving is abandoned: it is queued again once it is complete.
    pub(super) fn postpone(&self, frame: Frame<'g>) {
        if !frame.abandon() {
            self.enqueue(frame, PortQueue::push_front);
        }
    }

    /// Whether no unit needs individual checks.
    pub(super) fn all_healthy(&self, now: Instant) -> bool {
        self.port_state.units(|units| units.all_healthy(now))
    }

    /// The gate of each unit; usually all are healthy.
    pub(super) fn gates(&self, all_healthy: bool) -> impl Fn(u8) -> Gate {
        move |unit| if all_healthy { Gate::Open(Ready::Now) } else { self.gate(unit) }
    }

    pub(super) fn gate(&self, unit: u8) -> Gate {
        let gate = self.port_state.units(|units| {
            if !units.needs_check() {
                return Some(Gate::Open(Ready::Now));
            }
            match units.gate(unit, Instant::now()) {
                Gate::Open(_) if units.is_down(unit) => None,
                gate => Some(gate),
            }
        });
        // A unit that is down gets one probe at a time.
        let probed = || self.current().iter().any(|request| request.target() == unit);
        gate.unwrap_or_else(|| if probed() { Gate::Down } else { Gate::Open(Ready::Now) })
    }
}
