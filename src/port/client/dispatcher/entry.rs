//! Properties that the dispatcher derives from a request: its queue entry, the block it reads, and its part of a combined response.

use crate::frame::{Envelope, Fill, Frame, ReplyTo, Transaction};
use crate::modbus::PDU_BYTES_MAX;
use crate::modbus::pdu::Block;
use crate::port::client::queue::{Access, Entry, Requester};
use crate::settings::Merge;

/// The block that `frame` reads. `None` while it is still arriving: its CRC has not been checked yet.
pub(super) fn block(frame: &Frame<'_>) -> Option<Block> {
    if frame.filled().1 == Fill::Complete { frame.pdu(Block::of) } else { None }
}

impl Transaction {
    /// The response for the requester of `asked`, cut out of the `response` to the combined read.
    pub(super) fn response_to<'a>(
        &self,
        asked: Option<Block>,
        response: &'a [u8],
        part: &'a mut [u8; PDU_BYTES_MAX],
    ) -> &'a [u8] {
        match (self.combined, asked) {
            // A combined read covers all its parts.
            (Some(combined), Some(asked)) => combined.part(response, &asked, part).unwrap_or(&[]),
            _ => response,
        }
    }

    /// Restores the request in `frame` to its own read; returns whether it was combined with others.
    pub(super) fn split(&self, frame: &Frame<'_>) -> bool {
        let (Some(asked), Some(_)) = (self.asked, self.combined) else { return false };
        // Fits: it is the original request.
        let _ = frame.replace(&asked.request());
        true
    }
}

/// The queue entry of a request.
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

/// The requester, for fairness.
pub(super) fn requester(envelope: &Envelope) -> Requester {
    let origin = envelope.origin;
    // A port has connections or a line, not both.
    let connection = if let ReplyTo::Connection(connection) = origin.reply_to { connection } else { 0 };
    Requester::new((origin.port.0, connection), envelope.peer)
}
