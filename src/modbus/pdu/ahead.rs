//! The length of a PDU, determined from its beginning, for frames that are cut through.

use super::function::Form;
use super::{EXCEPTION_BIT, ResponseLength, request_length, response_length};
use crate::modbus::PDU_BYTES_MAX;

/// The end of a PDU, determined from its first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// At this length, including the function code; at most that of a PDU.
    At(usize),
    /// More bytes are needed to determine it.
    Later,
    /// Only silence ends it, or the PDU cannot be valid.
    Unknown,
}

/// The end of the request beginning with `so_far`.
pub fn request_end(so_far: &[u8]) -> End {
    if let Some(length) = request_length(so_far) {
        return within(length);
    }
    // Bytes needed for the byte count or sub-function.
    let told_by = match Form::of(so_far) {
        Some(Form::WriteMany(_)) => 6,
        Some(Form::ReadFile | Form::WriteFile | Form::Tunnel) => 2,
        Some(Form::ReadWrite { .. }) => 10,
        Some(Form::Diagnostics) => 3,
        _ => usize::from(so_far.is_empty()),
    };
    if so_far.len() < told_by { End::Later } else { End::Unknown }
}

/// The end of the response to `request` beginning with `so_far`; also unknown if it cannot be that response.
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
