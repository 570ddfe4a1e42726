//! What a desk must know of an order: its place in the queue, what it asks, and, once it is carried out, what its answer is
//! good for.

use embassy_time::Instant;

use crate::frame::{Fill, Frame, Way};
use crate::modbus::pdu;
use crate::port::cache::Question;
use crate::port::queue::{Access, Asker, Ticket};

/// An order that is being carried out.
pub(super) struct Current<'g> {
    pub(super) frame: Frame<'g>,
    /// Whether it may change something in its unit.
    pub(super) writes: bool,
    /// What the answer will be kept for, where it may be used again.
    pub(super) keep: Option<Question>,
    /// When it was given out.
    pub(super) since: Instant,
    /// Writes that had ended by then.
    pub(super) writes_ended: u32,
}

/// What a read asks, if its answer can be kept. What is still arriving asks nothing yet.
pub(super) fn question(frame: &Frame<'_>, unit: u8) -> Option<Question> {
    (frame.filled().1 == Fill::Complete).then_some(())?;
    frame.pdu(|request| Question::new(unit, request))
}

/// What the queue must know of an order.
pub(super) fn ticket(frame: &Frame<'_>) -> Ticket {
    let envelope = frame.envelope();
    let origin = envelope.origin;
    // A port has seats or a line, not both.
    let seat = if let Way::Seat(seat) = origin.way { seat } else { 0 };
    let access = match pdu::is_read(frame.function()) {
        false => Access::Write,
        true if envelope.sharing.merge => Access::SharedRead,
        true => Access::Read,
    };
    Ticket {
        asker: Asker { address: envelope.peer, connection: u32::from(origin.port.0) << 16 | u32::from(seat) },
        priority: envelope.priority,
        unit: envelope.target,
        deadline: envelope.deadline,
        access,
    }
}
