//! The data addresses that a request accesses, for rules that restrict them.

use super::function::{
    MASK_WRITE_REGISTER, READ_COILS, READ_FIFO_QUEUE, READ_INPUT_REGISTERS, READ_WRITE_MULTIPLE_REGISTERS,
    WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS, WRITE_SINGLE_COIL, WRITE_SINGLE_REGISTER,
};
use super::is_read;

/// Most registers that function 24 reads: the count at the requested address, and the queue after it (clause 6.18).
const FIFO_REGISTERS_MAX: u16 = 32;

/// A range of addresses, as on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// Whether they are written.
    pub write: bool,
    /// The first address.
    pub first: u16,
    /// The last address; above 65535 if the request wraps around.
    pub last: u32,
}

/// What a request does to a device's data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touched {
    /// Reads or writes these addresses: at most one extent of each.
    Cells([Option<Extent>; 2]),
    /// Changes nothing, and reads something without a data address.
    Other,
    /// Unknown, or not known yet.
    Unknown,
}

/// What `request`, which may be incomplete, does to a device's data.
pub fn touched(request: &[u8]) -> Touched {
    let word = |at: usize| Some(u16::from_be_bytes([*request.get(at)?, *request.get(at + 1)?]));
    let extent = |write, at, count: Option<u16>| {
        let (first, count) = (word(at)?, count?);
        Some(Extent { write, first, last: u32::from(first) + u32::from(count).saturating_sub(1) })
    };
    let one = |extent: Option<Extent>| extent.map(|extent| [Some(extent), None]);
    let cells = match request.first().copied().unwrap_or(0) {
        READ_COILS..=READ_INPUT_REGISTERS => one(extent(false, 1, word(3))),
        WRITE_SINGLE_COIL | WRITE_SINGLE_REGISTER | MASK_WRITE_REGISTER => one(extent(true, 1, Some(1))),
        WRITE_MULTIPLE_COILS | WRITE_MULTIPLE_REGISTERS => one(extent(true, 1, word(3))),
        READ_WRITE_MULTIPLE_REGISTERS => {
            let both = extent(false, 1, word(3)).zip(extent(true, 5, word(7)));
            both.map(|(read, written)| [Some(read), Some(written)])
        }
        READ_FIFO_QUEUE => one(extent(false, 1, Some(FIFO_REGISTERS_MAX))),
        _ if is_read(request) => return Touched::Other,
        _ => None,
    };
    cells.map_or(Touched::Unknown, Touched::Cells)
}
