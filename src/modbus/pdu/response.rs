//! The length of the response to a request, and whether a response matches.

use super::function::{Form, MEI_DEVICE_IDENTIFICATION, is_public};
use super::{EXCEPTION_BIT, file_response_length};
use crate::modbus::PDU_BYTES_MAX;

/// The end of a response PDU, determined from its beginning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResponseLength {
    /// At this length, including the function code. A wrong byte count can make it longer than a PDU.
    Known(usize),
    /// More bytes are needed to determine it.
    More,
    /// Only silence ends it.
    Silence,
}

/// Why a response does not match a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Misfit {
    /// It has another function, or is an exception without a code.
    #[error("the response is for another function")]
    Function,
    /// Its length differs from what the request implies.
    #[error("the response has the wrong length")]
    Length,
    /// A field that should repeat the request's differs.
    #[error("the response does not repeat the request's fields")]
    Echo,
}

/// The length of the response to `request`, of which `so_far` has arrived.
///
/// `request` has passed [`check_request`](super::check_request). The length of another function's response is unknown:
/// [`ResponseLength::Silence`].
pub fn response_length(request: &[u8], so_far: &[u8]) -> ResponseLength {
    use ResponseLength::{Known, More, Silence};

    let Some(&function) = request.first() else {
        return Silence;
    };
    match so_far.first() {
        None => return More,
        Some(&answered) if answered == function | EXCEPTION_BIT => return Known(2),
        Some(&answered) if answered != function => return Silence,
        Some(_) => {}
    }
    let Some(form) = Form::of(request) else { return Silence };
    match (form, request) {
        (Form::Read(cells), [_, _, _, high, low])
        | (Form::ReadWrite { read: cells, .. }, [_, _, _, high, low, ..]) => {
            Known(2 + cells.bytes(u16::from_be_bytes([*high, *low])))
        }
        (Form::Status(length), _) => Known(length),
        (Form::WriteOne(_) | Form::WriteMany(_), _) => Known(5),
        (Form::MaskWrite | Form::WriteFile, _) | (Form::Diagnostics, [_, 0, 0, ..]) => Known(request.len()),
        // The public sub-functions respond with one word; others are vendor-specific.
        (Form::Diagnostics, _) if is_public(request) => Known(5),
        (Form::EventLog | Form::Report, _) => match so_far {
            [_, count, ..] => Known(2 + usize::from(*count)),
            _ => More,
        },
        (Form::ReadFile, [_, _, groups @ ..]) => file_response_length(groups).map_or(Silence, Known),
        (Form::ReadFifo, _) => match so_far {
            [_, high, low, ..] => Known(3 + usize::from(u16::from_be_bytes([*high, *low]))),
            _ => More,
        },
        _ => Silence,
    }
}

/// Whether `response` matches `request`: it has the same function or is an exception to it, has the implied length, and repeats
/// the fields that it should.
///
/// For an unknown function only the code is compared.
pub fn fits(request: &[u8], response: &[u8]) -> Result<(), Misfit> {
    let (Some(&function), Some(&answered)) = (request.first(), response.first()) else {
        return Err(Misfit::Length);
    };
    if answered == function | EXCEPTION_BIT {
        return match response {
            [_, 0] => Err(Misfit::Function),
            [_, _] => Ok(()),
            _ => Err(Misfit::Length),
        };
    }
    if answered != function {
        return Err(Misfit::Function);
    }
    let length = match response_length(request, response) {
        ResponseLength::Known(length) => response.len() == length,
        ResponseLength::More => false,
        ResponseLength::Silence => true,
    };
    if !length || response.len() > PDU_BYTES_MAX || !counts(request, response) {
        return Err(Misfit::Length);
    }
    if repeats(request, response) { Ok(()) } else { Err(Misfit::Echo) }
}

/// Whether the counts inside `response` agree with its length, which has been checked.
fn counts(request: &[u8], response: &[u8]) -> bool {
    match (Form::of(response), response) {
        (Some(Form::Read(_) | Form::ReadWrite { .. }), [_, count, data @ ..]) => {
            usize::from(*count) == data.len()
        }
        // Status, event counter and message counter precede the events (clause 6.10).
        (Some(Form::EventLog), [_, count, ..]) => *count >= 6,
        (Some(Form::ReadFile), [_, count, groups @ ..]) => {
            usize::from(*count) == groups.len() && file_response_groups(request, groups)
        }
        // The number of registers precedes them; it counts neither itself nor the byte count (clause 6.18).
        (Some(Form::ReadFifo), [_, _, _, high, low, registers @ ..]) => {
            2 * usize::from(u16::from_be_bytes([*high, *low])) == registers.len()
        }
        (Some(Form::ReadFifo), _) => false,
        _ => true,
    }
}

/// Whether each group of a function 20 response has the length requested.
fn file_response_groups(request: &[u8], mut response: &[u8]) -> bool {
    let (asked, _) = request.get(2..).unwrap_or_default().as_chunks::<{ super::FILE_GROUP_BYTES }>();
    for [.., high, low] in asked {
        let bytes = 1 + 2 * usize::from(u16::from_be_bytes([*high, *low]));
        let Some((length, rest)) = response.split_first() else {
            return false;
        };
        match rest.get(bytes..) {
            Some(rest) if usize::from(*length) == bytes => response = rest,
            _ => return false,
        }
    }
    response.is_empty()
}

/// Whether `response` repeats the fields of `request` that it should.
fn repeats(request: &[u8], response: &[u8]) -> bool {
    let bytes = match (Form::of(request), request) {
        (Some(Form::WriteOne(_) | Form::WriteFile | Form::MaskWrite), _) => request.len(),
        // Function, address, quantity.
        (Some(Form::WriteMany(_)), _) => 5,
        // These sub-functions repeat the request's data (clause 6.8.1), the others return a register or counter.
        (Some(Form::Diagnostics), [_, 0, 0 | 1 | 3 | 4 | 10 | 20, ..]) => request.len(),
        (Some(Form::Diagnostics), _) => 3,
        // MEI type and read device ID code.
        (Some(Form::Tunnel), [_, MEI_DEVICE_IDENTIFICATION, ..]) => 3,
        (Some(Form::Tunnel), _) => 2,
        _ => 1,
    };
    request.get(..bytes).is_some_and(|repeated| response.starts_with(repeated))
}
