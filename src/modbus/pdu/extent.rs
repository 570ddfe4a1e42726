//! The data addresses that a request accesses, for rules that restrict them.

use super::function::Form;
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

/// The effect of a request on a device's data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Touched {
    /// Reads or writes these addresses: at most one extent of each.
    Cells([Option<Extent>; 2]),
    /// Changes nothing, and reads something without a data address.
    Other,
    /// Unknown, or not known yet.
    Unknown,
}

/// The effect of `request`, which may be incomplete, on a device's data.
pub fn touched(request: &[u8]) -> Touched {
    let word = |at: usize| Some(u16::from_be_bytes([*request.get(at)?, *request.get(at + 1)?]));
    // The quantity 0, which devices refuse, is that of one address here.
    let others = |at: usize| Some(word(at)?.saturating_sub(1));
    let extent = |write, at, others: Option<u16>| {
        let (first, others) = (word(at)?, others?);
        Some(Extent { write, first, last: u32::from(first) + u32::from(others) })
    };
    let one = |extent: Option<Extent>| extent.map(|extent| [Some(extent), None]);
    let cells = match Form::of(request) {
        Some(Form::Read(_)) => one(extent(false, 1, others(3))),
        Some(Form::WriteOne(_) | Form::MaskWrite) => one(extent(true, 1, Some(0))),
        Some(Form::WriteMany(_)) => one(extent(true, 1, others(3))),
        Some(Form::ReadWrite { .. }) => {
            let both = extent(false, 1, others(3)).zip(extent(true, 5, others(7)));
            both.map(|(read, written)| [Some(read), Some(written)])
        }
        Some(Form::ReadFifo) => one(extent(false, 1, Some(FIFO_REGISTERS_MAX - 1))),
        _ if is_read(request) => return Touched::Other,
        _ => None,
    };
    cells.map_or(Touched::Unknown, Touched::Cells)
}

/// Number of bytes of a request like `so_far` that determine its addresses; `None` if all of them are needed.
pub fn addresses_end(so_far: &[u8]) -> Option<usize> {
    match Form::of(so_far)? {
        // Address and quantity, or value.
        Form::Read(_) | Form::WriteOne(_) | Form::WriteMany(_) | Form::MaskWrite => Some(5),
        Form::ReadWrite { .. } => Some(9),
        _ => None,
    }
}
