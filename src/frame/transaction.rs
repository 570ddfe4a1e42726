//! The client-side port's state of the request it has on the wire.

use embassy_time::Instant;

use crate::modbus::pdu::Block;

/// The client-side port's state of a transaction. Stored in the frame, as a port has only a few of the gateway's transactions.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Transaction {
    /// Whether it may change something in its unit.
    pub(crate) writes: bool,
    /// The block the requester reads, if it is a block.
    pub(crate) asked: Option<Block>,
    /// The block of the combined read sent instead, if any.
    pub(crate) combined: Option<Block>,
    /// When it was sent.
    pub(crate) since: Instant,
    /// Number of writes that had ended by then.
    pub(crate) writes_ended: u16,
}

impl Transaction {
    pub(super) const NONE: Self =
        Self { writes: false, asked: None, combined: None, since: Instant::MIN, writes_ended: 0 };
}
