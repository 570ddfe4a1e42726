//! What came of a request, and who gets it.

use embassy_time::Instant;

use super::{Desk, is_answering};
use crate::frame::{Envelope, Errand, Frame, Stage};
use crate::modbus::pdu::{self, Block, EXCEPTION_BIT};
use crate::modbus::{Exception, PDU_BYTES_MAX};
use crate::port::client::cache::Question;
use crate::port::client::dispatcher::order::block;
use crate::port::client::queue::PortQueue;
use crate::port::client::servers::LINKS_MAX;
use crate::stats::Event;

impl<'g> Desk<'g> {
    /// Sends `order` home with what it holds by now as its answer.
    pub(crate) fn done(&self, order: &Frame<'g>) {
        let Some((frame, errand)) = self.take(order) else { return };
        if order.function() & EXCEPTION_BIT != 0 && errand.part(order) {
            return self.part(frame);
        }
        if order.sharing().cache_ms == 0 && !order.is_laden() {
            return self.give(frame);
        }
        let answer = &order.content();
        let give = |frame: Frame<'g>, asked| {
            let mut part = [0; PDU_BYTES_MAX];
            let answer = errand.answer_to(asked, answer, &mut part);
            self.keep(&errand, &frame, asked, answer);
            if !is_answering(&frame) {
                // It fitted into a frame of the same size.
                let _ = frame.replace(answer);
            }
            self.give(frame);
        };
        give(frame, errand.asked);
        while let Some(rider) = order.unload() {
            self.place.stats.count(Event::Merged);
            let asked = block(&rider);
            give(rider, asked);
        }
    }

    /// Sends home `frame`, which holds its answer, unless whoever asked has it already.
    pub(super) fn give(&self, frame: Frame<'g>) {
        if is_answering(&frame) {
            self.gateway.note(&frame, &frame.envelope());
        } else {
            self.gateway.answered(frame);
        }
    }

    /// Keeps the `answer` to a request for `asked` if it may be used again.
    pub(super) fn keep(&self, errand: &Errand, frame: &Frame<'g>, asked: Option<Block>, answer: &[u8]) {
        let is_exception = answer.first().is_some_and(|function| function & EXCEPTION_BIT != 0);
        // The device may have read before a write that has ended meanwhile.
        let is_old = errand.writes_ended != self.writes_ended.get();
        let Some(block) = asked.filter(|_| !is_exception && !is_old) else { return };
        if frame.sharing().cache_ms > 0 {
            let unit = frame.target();
            self.cache().keep(Question { unit, block }, answer, errand.since);
        }
    }

    /// The unit refused what several reads had joined: each is sent by itself, before anything that came after it.
    pub(super) fn part(&self, order: Frame<'g>) {
        let unit = order.target();
        self.place.stats.count(Event::Parted);
        self.place.units(|units| units.refused_join(unit, Instant::now()));
        self.postpone_each(order);
    }

    /// `order`, which was sent while it arrived, is whole: what it does is known by now.
    pub(crate) fn arrived(&self, order: &Frame<'g>) {
        let writes = !order.pdu(pdu::is_read);
        let asked = block(order);
        order.amend_errand(|errand| (errand.writes, errand.asked) = (writes, asked));
    }

    /// Gives whoever asked `order` while its answer is still written into it.
    pub(crate) fn answering(&self, order: &Frame<'g>) {
        order.set_stage(Stage::Answering);
        self.gateway.inbox.send(order.share());
    }

    /// Drops `order`, which was broken off while it arrived: whoever sent it knows.
    pub(crate) fn forget(&self, order: &Frame<'g>) {
        drop(self.take(order));
    }

    /// Sends `order` home without an answer: a broadcast.
    pub(crate) fn done_silently(&self, order: &Frame<'g>) {
        if let Some((frame, _)) = self.take(order) {
            self.gateway.finish_broadcast(frame);
        }
    }

    /// `order` got no answer: it and those that ride on it are repeated up to `retries` times if it is a read, else
    /// answered 0Bh.
    ///
    /// A write is never repeated: it may have been carried out. A repeat waits its turn like any other order, and until the
    /// late answer can no longer come.
    pub(crate) fn failed(&self, order: &Frame<'g>, retries: u8) {
        let Some((frame, errand)) = self.take(order) else { return };
        errand.part(&frame);
        let mut repeated = self.again(frame, retries);
        let Envelope { cause, .. } = order.envelope();
        while let Some(rider) = order.unload() {
            rider.blame(cause);
            repeated |= self.again(rider, retries);
        }
        if repeated {
            self.place.stats.count(Event::Retry);
        }
    }

    /// Ends the carrying out of `order`, and tells what was noted of it.
    pub(super) fn take(&self, order: &Frame<'g>) -> Option<(Frame<'g>, Errand)> {
        let mut current = self.current();
        let at = current.iter().position(|current| current.is(order))?;
        if LINKS_MAX > 1 && current.is_full() {
            // Others may have waited for that.
            self.news.iter().for_each(|news| news.signal(()));
        }
        let ended = current.swap_remove(at);
        let errand = ended.errand();
        if errand.writes {
            self.writes_ended.set(self.writes_ended.get().wrapping_add(1));
            self.cache().written(order.target());
        }
        Some((ended, errand))
    }

    /// Puts an order that got no answer back in the queue, or answers it 0Bh; says which.
    pub(super) fn again(&self, frame: Frame<'g>, retries: u8) -> bool {
        let mut envelope = frame.envelope();
        let is_last = envelope.paced || envelope.repeats >= retries;
        if is_last || is_answering(&frame) || !frame.pdu(pdu::is_read) {
            self.give_up(frame);
            return false;
        }
        envelope.repeats += 1;
        frame.address(envelope);
        self.enqueue(frame, &envelope, PortQueue::push);
        true
    }

    /// Answers an order 0Bh, unless its answer has begun: then nothing can follow it.
    pub(super) fn give_up(&self, frame: Frame<'g>) {
        if is_answering(&frame) {
            self.gateway.note(&frame, &frame.envelope());
        } else {
            self.gateway.refuse(frame, Exception::GATEWAY_NO_RESPONSE);
        }
    }
}
