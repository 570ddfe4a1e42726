//! Requests in flight: which one is sent next, and what its outcome is: response, retry, exception, or nothing.

use embassy_time::Instant;

use super::{Dispatcher, Proving, care, is_responding, milliseconds};
use crate::frame::{Fill, Frame, Stage, Transaction};
use crate::gateway::unit_health::{Gate, Ready, Step};
use crate::modbus::pdu::{self, Block, EXCEPTION_BIT};
use crate::modbus::{Exception, PDU_BYTES_MAX};
use crate::port::client::cache::CacheKey;
use crate::port::client::dispatcher::entry::block;
use crate::port::client::queue::{BROADCAST, Entry, Next, PortQueue};
use crate::port::client::servers::CONNECTIONS_MAX;
use crate::settings::AUDIT;
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

    /// Completes `request` with the response in its frame, also for the requests merged into it.
    pub(crate) fn done(&self, request: &Frame<'g>) {
        let Some(frame) = self.end_transaction(request) else { return };
        // Only then one can have come back.
        if AUDIT && self.saw_down.get() {
            self.tell_health(request.target());
        }
        if request.function() & EXCEPTION_BIT != 0 && frame.transaction().split(request) {
            return self.split(frame);
        }
        if request.sharing().cache_ms == 0 && !request.has_merged() {
            return self.deliver(frame);
        }
        let (response, transaction) = (&request.content(), request.transaction());
        let deliver = |frame: Frame<'g>, asked| {
            let mut part = [0; PDU_BYTES_MAX];
            let response = transaction.response_to(asked, response, &mut part);
            self.keep(&transaction, &frame, asked, response);
            if !is_responding(&frame) {
                // Fits: it came from a frame of the same size.
                let _ = frame.replace(response);
            }
            self.deliver(frame);
        };
        deliver(frame, transaction.asked);
        while let Some(merged) = request.take_merged() {
            self.port_state.stats.count(Event::Merged);
            let asked = block(&merged);
            deliver(merged, asked);
        }
    }

    /// Returns `frame` with its response to the router, unless the requester has received it already.
    pub(super) fn deliver(&self, frame: Frame<'g>) {
        if is_responding(&frame) {
            self.gateway.note(&frame);
        } else {
            self.gateway.answered(frame);
        }
    }

    /// Caches the `response` to a read of `asked` if it is valid.
    pub(super) fn keep(
        &self,
        transaction: &Transaction,
        frame: &Frame<'g>,
        asked: Option<Block>,
        response: &[u8],
    ) {
        let is_exception = response.first().is_some_and(|function| function & EXCEPTION_BIT != 0);
        // The device may have read its values before a write that has ended meanwhile.
        let is_old = transaction.writes_ended != self.writes_ended.get();
        let Some(block) = asked.filter(|_| !is_exception && !is_old) else { return };
        if frame.sharing().cache_ms > 0 {
            let unit = frame.target();
            self.cache().keep(CacheKey { unit, block }, response, transaction.since);
        }
    }

    /// The unit refused a combined read: each read is sent on its own, ahead of later requests.
    pub(super) fn split(&self, request: Frame<'g>) {
        let unit = request.target();
        self.port_state.stats.count(Event::Parted);
        self.port_state.units(|units| units.refused_combined(unit, Instant::now()));
        self.postpone_each(request);
    }

    /// Updates `request`, forwarded while it arrived, now that it is complete: its function and block are known.
    pub(crate) fn arrived(&self, request: &Frame<'g>) {
        let writes = !request.pdu(pdu::is_read);
        let asked = block(request);
        request.amend_transaction(|transaction| (transaction.writes, transaction.asked) = (writes, asked));
    }

    /// Hands `request` to the requester while its response is still being written into it.
    pub(crate) fn responding(&self, request: &Frame<'g>) {
        request.set_stage(Stage::Responding);
        self.gateway.inbox.send(request.share());
    }

    /// Drops `request`, which broke off while it arrived; its sender knows that.
    pub(crate) fn forget(&self, request: &Frame<'g>) {
        drop(self.end_transaction(request));
    }

    /// Completes a broadcast, which has no response.
    pub(crate) fn done_without_response(&self, request: &Frame<'g>) {
        if let Some(frame) = self.end_transaction(request) {
            self.gateway.finish_broadcast(frame);
        }
    }

    /// Handles that `request` got no response: it and the requests merged into it are repeated up to `retries` times if they are
    /// reads, and get 0Bh otherwise.
    ///
    /// Writes are never repeated, since they may have been executed. A repeat queues like any other request, until a late response
    /// can no longer arrive.
    pub(crate) fn failed(&self, request: &Frame<'g>, retries: u8) {
        let Some(frame) = self.end_transaction(request) else { return };
        self.tell_health(request.target());
        frame.transaction().split(&frame);
        let mut repeated = self.retry(frame, retries);
        let cause = request.read(|envelope| envelope.cause);
        while let Some(merged) = request.take_merged() {
            merged.blame(cause);
            repeated |= self.retry(merged, retries);
        }
        if repeated {
            self.port_state.stats.count(Event::Retry);
        }
    }

    /// Writes into the audit trail if `unit` went down or came back.
    fn tell_health(&self, unit: u8) {
        if AUDIT && let Some(is_up) = self.port_state.units(|units| units.turned(unit)) {
            self.saw_down.set(true);
            self.gateway.audit_unit(self.id, unit, is_up);
        }
    }

    /// Ends the transaction of `request`, whose state stays in the frame, and returns the handle that was kept of it.
    pub(super) fn end_transaction(&self, request: &Frame<'g>) -> Option<Frame<'g>> {
        let mut current = self.current();
        let at = current.iter().position(|current| current.is(request))?;
        if CONNECTIONS_MAX > 1 && current.is_full() {
            // Connections may have been waiting for room.
            self.changed.iter().for_each(|changed| changed.set(true));
            self.task.borrow_mut().wake();
        }
        let ended = current.swap_remove(at);
        if ended.transaction().writes {
            self.writes_ended.set(self.writes_ended.get().wrapping_add(1));
            self.cache().written(request.target());
        }
        Some(ended)
    }

    /// Requeues a request that got no response, or answers it 0Bh; returns whether it was requeued.
    pub(super) fn retry(&self, frame: Frame<'g>, retries: u8) -> bool {
        let is_last = frame.read(|envelope| envelope.paced || envelope.repeats >= retries);
        if is_last || is_responding(&frame) || !frame.pdu(pdu::is_read) {
            self.give_up(frame);
            return false;
        }
        frame.amend(|envelope| envelope.repeats += 1);
        self.enqueue(frame, PortQueue::push);
        true
    }

    /// Answers a request 0Bh, unless its response is already being forwarded: nothing can follow that.
    pub(super) fn give_up(&self, frame: Frame<'g>) {
        if is_responding(&frame) {
            self.gateway.note(&frame);
        } else {
            self.gateway.refuse(frame, Exception::GATEWAY_NO_RESPONSE);
        }
    }
}
