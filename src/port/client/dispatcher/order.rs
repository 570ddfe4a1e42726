//! What a desk must know of an order: its place in the queue, what it asks, and, once it is carried out, what its answer is
//! good for.

use crate::frame::{Envelope, Errand, Fill, Frame, Way};
use crate::modbus::PDU_BYTES_MAX;
use crate::modbus::pdu::Block;
use crate::port::client::queue::{Access, Asker, Ticket};
use crate::settings::Merge;

/// What `frame` asks for, if that is a block and sure: of a frame that still arrives nobody knows yet whether it is good.
pub(super) fn block(frame: &Frame<'_>) -> Option<Block> {
    if frame.filled().1 == Fill::Complete { frame.pdu(Block::of) } else { None }
}

impl Errand {
    /// The answer to who wanted `asked`, which follows from the `answer` to what was asked for.
    pub(super) fn answer_to<'a>(
        &self,
        asked: Option<Block>,
        answer: &'a [u8],
        part: &'a mut [u8; PDU_BYTES_MAX],
    ) -> &'a [u8] {
        match (self.joined, asked) {
            // All that joined are parts of it.
            (Some(joined), Some(asked)) => joined.part(answer, &asked, part).unwrap_or(&[]),
            _ => answer,
        }
    }

    /// Takes back that others have joined the order `frame`; says whether they had.
    pub(super) fn part(&self, frame: &Frame<'_>) -> bool {
        let (Some(asked), Some(_)) = (self.asked, self.joined) else { return false };
        // It was in there before.
        let _ = frame.replace(&asked.request());
        true
    }
}

/// What the queue must know of an order, which is a read or not.
pub(super) fn ticket(envelope: &Envelope, is_read: bool) -> Ticket {
    let access = match is_read {
        false => Access::Write,
        true if envelope.sharing.merge == Merge::Off => Access::Read,
        true => Access::SharedRead,
    };
    Ticket {
        asker: asker(envelope),
        priority: envelope.priority,
        unit: envelope.target,
        deadline: envelope.deadline,
        access,
    }
}

/// Who asked, as far as fairness goes.
pub(super) fn asker(envelope: &Envelope) -> Asker {
    let origin = envelope.origin;
    // A port has seats or a line, not both.
    let seat = if let Way::Seat(seat) = origin.way { seat } else { 0 };
    Asker::new((origin.port.0, seat), envelope.peer)
}
