//! Which data addresses a request touches, for rules that allow some and refuse others.

use super::function::{
    MASK_WRITE_REGISTER, READ_COILS, READ_FIFO_QUEUE, READ_INPUT_REGISTERS, READ_WRITE_MULTIPLE_REGISTERS,
    WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS, WRITE_SINGLE_COIL, WRITE_SINGLE_REGISTER,
};

/// Neighbouring addresses, as they are on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// Whether they are written.
    pub write: bool,
    /// The first address.
    pub first: u16,
    /// The last one; behind 65535 when the request runs over the end.
    pub last: u32,
}

/// What `request` reads and writes: at most one extent of each. Functions that carry no data addresses have none.
pub fn extents(request: &[u8]) -> [Option<Extent>; 2] {
    let word = |at: usize| Some(u16::from_be_bytes([*request.get(at)?, *request.get(at + 1)?]));
    let extent = |write, at, count: Option<u16>| {
        let (first, count) = (word(at)?, count?);
        Some(Extent { write, first, last: u32::from(first) + u32::from(count).saturating_sub(1) })
    };
    match request.first().copied().unwrap_or(0) {
        READ_COILS..=READ_INPUT_REGISTERS => [extent(false, 1, word(3)), None],
        WRITE_SINGLE_COIL | WRITE_SINGLE_REGISTER | MASK_WRITE_REGISTER => [extent(true, 1, Some(1)), None],
        WRITE_MULTIPLE_COILS | WRITE_MULTIPLE_REGISTERS => [extent(true, 1, word(3)), None],
        READ_WRITE_MULTIPLE_REGISTERS => [extent(false, 1, word(3)), extent(true, 5, word(7))],
        READ_FIFO_QUEUE => [extent(false, 1, Some(1)), None],
        _ => [None, None],
    }
}
