//! Outcomes of requests on a connection.

use embassy_time::Instant;

use crate::frame::{Cause, Frame, Stage};
use crate::modbus::Exception;
use crate::modbus::tcp::Header;

/// What the next request of a connection must wait for.
pub(super) enum Waits {
    /// Nothing.
    No,
    /// This time; if it is never, the earlier responses.
    ForTurn(Instant),
    /// A free frame.
    ForFrame,
    /// Sending this exception, which refuses the previous request.
    ForReply(Header, [u8; 2]),
}

/// A response to a client.
pub(super) enum Response<'g> {
    /// An exception from this port.
    Refusal(Header, [u8; 2]),
    /// A frame returned by the router.
    Response(Frame<'g>),
}

impl Response<'_> {
    pub(super) fn worth(&self) -> Worth {
        let Self::Response(frame) = self else { return Worth::Refused };
        match frame.read(|envelope| envelope.cause) {
            Cause::Unsent if frame.pdu(|pdu| pdu.get(1) == Some(&Exception::BUSY.0)) => Worth::Crowded,
            Cause::Unsent => Worth::Refused,
            _ if frame.stage() == Stage::Silence => Worth::Refused,
            _ => Worth::Answered,
        }
    }
}

/// The effect of an outcome on the window for later requests.
pub(super) enum Worth {
    /// A unit responded.
    Answered,
    /// No unit was asked, or there is no response.
    Refused,
    /// The queue is full.
    Crowded,
}

/// The handling of a request.
pub(super) enum Taken {
    /// Sent to the router.
    Sent,
    /// Answered by this port.
    Refused(Exception),
    /// No frame is free.
    Starved,
}
