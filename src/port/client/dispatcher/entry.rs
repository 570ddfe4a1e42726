//! What a dispatcher must know of a request: its place in the queue, what it asks, and, once it is carried out, what its response is
//! good for.

use crate::frame::{Envelope, Fill, Frame, ReplyTo, Transaction};
use crate::modbus::PDU_BYTES_MAX;
use crate::modbus::pdu::Block;
use crate::port::client::queue::{Access, Entry, Requester};
use crate::settings::Merge;

/// What `frame` asks for, if that is a block and sure: of a frame that still arrives nobody knows yet whether it is good.
pub(super) fn block(frame: &Frame<'_>) -> Option<Block> {
    if frame.filled().1 == Fill::Complete { frame.pdu(Block::of) } else { None }
}

impl Transaction {
    /// The response to who wanted `asked`, which follows from the `response` to what was asked for.
    pub(super) fn response_to<'a>(
        &self,
        asked: Option<Block>,
        response: &'a [u8],
        part: &'a mut [u8; PDU_BYTES_MAX],
    ) -> &'a [u8] {
        match (self.combined, asked) {
            // All reads that it combines are parts of it.
            (Some(combined), Some(asked)) => combined.part(response, &asked, part).unwrap_or(&[]),
            _ => response,
        }
    }

    /// Reduces the request in `frame` to what it asked for itself; says whether it was combined with others.
    pub(super) fn split(&self, frame: &Frame<'_>) -> bool {
        let (Some(asked), Some(_)) = (self.asked, self.combined) else { return false };
        // It was in there before.
        let _ = frame.replace(&asked.request());
        true
    }
}

/// What the queue must know of a request, which is a read or not.
pub(super) fn entry(envelope: &Envelope, is_read: bool) -> Entry {
    let access = match is_read {
        false => Access::Write,
        true if envelope.sharing.merge == Merge::Off => Access::Read,
        true => Access::SharedRead,
    };
    Entry {
        requester: requester(envelope),
        priority: envelope.priority,
        unit: envelope.target,
        deadline: envelope.deadline,
        access,
    }
}

/// Who asked, as far as fairness goes.
pub(super) fn requester(envelope: &Envelope) -> Requester {
    let origin = envelope.origin;
    // A port has connections or a line, not both.
    let connection = if let ReplyTo::Connection(connection) = origin.reply_to { connection } else { 0 };
    Requester::new((origin.port.0, connection), envelope.peer)
}
