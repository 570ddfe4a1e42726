//! What came of a request, and who gets it.

use embassy_time::Instant;

use super::{Dispatcher, is_responding};
use crate::frame::{Envelope, Frame, Stage, Transaction};
use crate::modbus::pdu::{self, Block, EXCEPTION_BIT};
use crate::modbus::{Exception, PDU_BYTES_MAX};
use crate::port::client::cache::Question;
use crate::port::client::dispatcher::entry::block;
use crate::port::client::queue::PortQueue;
use crate::port::client::servers::CONNECTIONS_MAX;
use crate::stats::Event;

impl<'g> Dispatcher<'g> {
    /// Sends `request` home with what it holds by now as its response.
    pub(crate) fn done(&self, request: &Frame<'g>) {
        let Some((frame, transaction)) = self.take(request) else { return };
        if request.function() & EXCEPTION_BIT != 0 && transaction.split(request) {
            return self.split(frame);
        }
        if request.sharing().cache_ms == 0 && !request.is_laden() {
            return self.give(frame);
        }
        let response = &request.content();
        let give = |frame: Frame<'g>, asked| {
            let mut part = [0; PDU_BYTES_MAX];
            let response = transaction.response_to(asked, response, &mut part);
            self.keep(&transaction, &frame, asked, response);
            if !is_responding(&frame) {
                // It fitted into a frame of the same size.
                let _ = frame.replace(response);
            }
            self.give(frame);
        };
        give(frame, transaction.asked);
        while let Some(merged) = request.unload() {
            self.port_state.stats.count(Event::Merged);
            let asked = block(&merged);
            give(merged, asked);
        }
    }

    /// Sends home `frame`, which holds its response, unless whoever asked has it already.
    pub(super) fn give(&self, frame: Frame<'g>) {
        if is_responding(&frame) {
            self.gateway.note(&frame, &frame.envelope());
        } else {
            self.gateway.answered(frame);
        }
    }

    /// Keeps the `response` to a request for `asked` if it may be used again.
    pub(super) fn keep(
        &self,
        transaction: &Transaction,
        frame: &Frame<'g>,
        asked: Option<Block>,
        response: &[u8],
    ) {
        let is_exception = response.first().is_some_and(|function| function & EXCEPTION_BIT != 0);
        // The device may have read before a write that has ended meanwhile.
        let is_old = transaction.writes_ended != self.writes_ended.get();
        let Some(block) = asked.filter(|_| !is_exception && !is_old) else { return };
        if frame.sharing().cache_ms > 0 {
            let unit = frame.target();
            self.cache().keep(Question { unit, block }, response, transaction.since);
        }
    }

    /// The unit refused what several reads had joined: each is sent by itself, before anything that came after it.
    pub(super) fn split(&self, request: Frame<'g>) {
        let unit = request.target();
        self.port_state.stats.count(Event::Parted);
        self.port_state.units(|units| units.refused_combined(unit, Instant::now()));
        self.postpone_each(request);
    }

    /// `request`, which was sent while it arrived, is whole: what it does is known by now.
    pub(crate) fn arrived(&self, request: &Frame<'g>) {
        let writes = !request.pdu(pdu::is_read);
        let asked = block(request);
        request.amend_transaction(|transaction| (transaction.writes, transaction.asked) = (writes, asked));
    }

    /// Gives whoever asked `request` while its response is still written into it.
    pub(crate) fn responding(&self, request: &Frame<'g>) {
        request.set_stage(Stage::Responding);
        self.gateway.inbox.send(request.share());
    }

    /// Drops `request`, which was broken off while it arrived: whoever sent it knows.
    pub(crate) fn forget(&self, request: &Frame<'g>) {
        drop(self.take(request));
    }

    /// Sends `request` home without a response: a broadcast.
    pub(crate) fn done_silently(&self, request: &Frame<'g>) {
        if let Some((frame, _)) = self.take(request) {
            self.gateway.finish_broadcast(frame);
        }
    }

    /// `request` got no response: it and those that ride on it are repeated up to `retries` times if it is a read, else
    /// answered 0Bh.
    ///
    /// A write is never repeated: it may have been carried out. A repeat waits its turn like any other request, and until the
    /// late response can no longer come.
    pub(crate) fn failed(&self, request: &Frame<'g>, retries: u8) {
        let Some((frame, transaction)) = self.take(request) else { return };
        transaction.split(&frame);
        let mut repeated = self.again(frame, retries);
        let Envelope { cause, .. } = request.envelope();
        while let Some(merged) = request.unload() {
            merged.blame(cause);
            repeated |= self.again(merged, retries);
        }
        if repeated {
            self.port_state.stats.count(Event::Retry);
        }
    }

    /// Ends the carrying out of `request`, and tells what was noted of it.
    pub(super) fn take(&self, request: &Frame<'g>) -> Option<(Frame<'g>, Transaction)> {
        let mut current = self.current();
        let at = current.iter().position(|current| current.is(request))?;
        if CONNECTIONS_MAX > 1 && current.is_full() {
            // Others may have waited for that.
            self.changed.iter().for_each(|changed| changed.signal(()));
        }
        let ended = current.swap_remove(at);
        let transaction = ended.transaction();
        if transaction.writes {
            self.writes_ended.set(self.writes_ended.get().wrapping_add(1));
            self.cache().written(request.target());
        }
        Some((ended, transaction))
    }

    /// Puts a request that got no response back in the queue, or answers it 0Bh; says which.
    pub(super) fn again(&self, frame: Frame<'g>, retries: u8) -> bool {
        let mut envelope = frame.envelope();
        let is_last = envelope.paced || envelope.repeats >= retries;
        if is_last || is_responding(&frame) || !frame.pdu(pdu::is_read) {
            self.give_up(frame);
            return false;
        }
        envelope.repeats += 1;
        frame.address(envelope);
        self.enqueue(frame, &envelope, PortQueue::push);
        true
    }

    /// Answers a request 0Bh, unless its response has begun: then nothing can follow it.
    pub(super) fn give_up(&self, frame: Frame<'g>) {
        if is_responding(&frame) {
            self.gateway.note(&frame, &frame.envelope());
        } else {
            self.gateway.refuse(frame, Exception::GATEWAY_NO_RESPONSE);
        }
    }
}
