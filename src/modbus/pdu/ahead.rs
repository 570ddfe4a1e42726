//! What the beginning of a PDU tells of its end, for frames that are passed on while they arrive.

use super::function::Form;
use super::{EXCEPTION_BIT, ResponseLength, request_length, response_length};
use crate::modbus::PDU_BYTES_MAX;

/// Where the PDU that begins with some bytes ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// At this many bytes, the function code included: no more than a PDU can have.
    At(usize),
    /// More bytes will tell.
    Later,
    /// Only the silence behind it tells, or it is nothing that could be good.
    Unknown,
}

/// Where the request that begins with `so_far` ends.
pub fn request_end(so_far: &[u8]) -> End {
    if let Some(length) = request_length(so_far) {
        return within(length);
    }
    // Up to the byte count, or the sub-function.
    let told_by = match Form::of(so_far) {
        Some(Form::WriteMany(_)) => 6,
        Some(Form::ReadFile | Form::WriteFile | Form::Tunnel) => 2,
        Some(Form::ReadWrite { .. }) => 10,
        Some(Form::Diagnostics) => 3,
        _ => usize::from(so_far.is_empty()),
    };
    if so_far.len() < told_by { End::Later } else { End::Unknown }
}

/// Where the response to `request` ends that begins with `so_far`; unknown also when it can be no response to that.
pub fn response_end(request: &[u8], so_far: &[u8]) -> End {
    let counts_bytes = matches!(Form::of(so_far), Some(Form::Read(_) | Form::ReadWrite { .. }));
    match (response_length(request, so_far), so_far) {
        (ResponseLength::Known(length), [_, count, ..])
            if counts_bytes && usize::from(*count) + 2 != length =>
        {
            End::Unknown
        }
        (ResponseLength::Known(_), [answered, 0, ..]) if answered & EXCEPTION_BIT != 0 => End::Unknown,
        (ResponseLength::Known(length), _) => within(length),
        (ResponseLength::More, _) => End::Later,
        (ResponseLength::Silence, _) => End::Unknown,
    }
}

fn within(length: usize) -> End {
    if length <= PDU_BYTES_MAX { End::At(length) } else { End::Unknown }
}
