//! What a port notes of a request that it carries out: what the response is good for.

use embassy_time::Instant;

use crate::modbus::pdu::Block;

/// What a port notes of a request that it carries out. It lies in the frame: a port has few of those that there are.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Transaction {
    /// Whether it may change something in its unit.
    pub(crate) writes: bool,
    /// What its requester wants, if that is a block.
    pub(crate) asked: Option<Block>,
    /// What is asked for in its place, where others have combined.
    pub(crate) combined: Option<Block>,
    /// When it was given out.
    pub(crate) since: Instant,
    /// Writes that had ended by then.
    pub(crate) writes_ended: u16,
}

impl Transaction {
    pub(super) const NONE: Self =
        Self { writes: false, asked: None, combined: None, since: Instant::MIN, writes_ended: 0 };
}
