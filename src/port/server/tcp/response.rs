//! What becomes of a request on its connection.

use embassy_time::Instant;

use crate::frame::{Cause, Frame, Stage};
use crate::modbus::Exception;
use crate::modbus::tcp::Header;

/// What the next request of a connection has to wait for.
pub(super) enum Waits {
    /// Nothing: it can be taken as soon as it has come.
    No,
    /// This moment, or, if that never comes, the responses to those before it.
    ForTurn(Instant),
    /// There is no frame for it now.
    ForFrame,
    /// The one before it is refused: this is the response.
    ForReply(Header, [u8; 2]),
}

/// What a client gets.
pub(super) enum Response<'g> {
    /// A refusal.
    Refusal(Header, [u8; 2]),
    /// What came home.
    Response(Frame<'g>),
}

impl Response<'_> {
    pub(super) fn worth(&self) -> Worth {
        let Self::Response(frame) = self else { return Worth::Refused };
        match frame.envelope().cause {
            Cause::Unsent if frame.pdu(|pdu| pdu.get(1) == Some(&Exception::BUSY.0)) => Worth::Crowded,
            Cause::Unsent => Worth::Refused,
            _ if frame.stage() == Stage::Silence => Worth::Refused,
            _ => Worth::Answered,
        }
    }
}

/// What a reply says of the requests that follow it.
pub(super) enum Worth {
    /// Somebody was asked.
    Answered,
    /// Nobody was asked, or nobody is to answer.
    Refused,
    /// Too many wait.
    Crowded,
}

/// What became of a request.
pub(super) enum Taken {
    /// The router has it.
    Sent,
    /// It is answered here.
    Refused(Exception),
    /// There is no frame for it now.
    Starved,
}
