//! Validation of requests, before they occupy a device.

use super::function::{Cells, Form, MEI_DEVICE_IDENTIFICATION, is_public};
use super::{ResponseLength, file_response_length, response_length};
use crate::modbus::{Exception, PDU_BYTES_MAX};

/// Checks whether a server could accept this request; returns the exception if not.
///
/// A public function must have a valid length, byte count and quantity. Addresses are up to the device, and an unknown function
/// is accepted at any length.
pub fn check_request(pdu: &[u8]) -> Result<(), Exception> {
    let Some((&function, fields)) = pdu.split_first() else {
        return Err(Exception::ILLEGAL_VALUE);
    };
    // Clause 4.1: 0 is not valid, 128 to 255 are for exceptions.
    if !(1..super::EXCEPTION_BIT).contains(&function) {
        return Err(Exception::ILLEGAL_FUNCTION);
    }
    if pdu.len() <= PDU_BYTES_MAX && Form::of(pdu).is_none_or(|form| possible(form, fields)) {
        Ok(())
    } else {
        Err(Exception::ILLEGAL_VALUE)
    }
}

/// Whether `request` is a read whose response would not fit a PDU.
pub(crate) fn is_beyond_response(request: &[u8]) -> bool {
    let is_read = matches!(Form::of(request), Some(Form::Read(_)));
    // A read's response length depends on the request only, so the second argument is irrelevant.
    let length = response_length(request, request);
    is_read && matches!(length, ResponseLength::Known(length) if length > PDU_BYTES_MAX)
}

/// The length of the request beginning with `so_far`, including the function code, where its function determines it; a frame of
/// another length is not a request.
pub fn request_length(so_far: &[u8]) -> Option<usize> {
    let counted = |at: usize| Some(at + 1 + usize::from(*so_far.get(at)?));
    match Form::of(so_far)? {
        Form::Read(_) | Form::WriteOne(_) => Some(5),
        Form::Status(_) | Form::Report | Form::EventLog => Some(1),
        Form::Diagnostics => is_public(so_far).then_some(5),
        Form::WriteMany(_) => counted(5),
        Form::ReadFile | Form::WriteFile => counted(1),
        Form::MaskWrite => Some(7),
        Form::ReadWrite { .. } => counted(9),
        Form::ReadFifo => Some(3),
        Form::Tunnel => (so_far.get(1) == Some(&MEI_DEVICE_IDENTIFICATION)).then_some(4),
    }
}

/// Whether `fields`, the bytes after the function code, are valid for a request of this `form`.
fn possible(form: Form, fields: &[u8]) -> bool {
    match (form, fields) {
        (Form::Read(cells), fields) => reads(fields, cells),
        (Form::WriteOne(Cells { bits: 1, .. }), fields) => matches!(fields, [_, _, 0x00 | 0xFF, 0x00]),
        (Form::WriteOne(_), fields) => fields.len() == 4,
        (Form::Status(_) | Form::Report | Form::EventLog, fields) => fields.is_empty(),
        // Data has two bytes or, for sub-function 0, "N x 2"; some devices accept any length, so the device decides.
        (Form::Diagnostics, fields) => fields.len() >= 2,
        (Form::WriteMany(cells), fields) => writes(fields, cells),
        (Form::ReadFile, [count, groups @ ..]) => {
            usize::from(*count) == groups.len() && file_response_length(groups).is_some()
        }
        (Form::WriteFile, [count, groups @ ..]) => usize::from(*count) == groups.len() && file_groups(groups),
        (Form::MaskWrite, fields) => fields.len() == 6,
        (Form::ReadWrite { read, write }, fields) => fields
            .split_at_checked(4)
            .is_some_and(|(first, behind)| reads(first, read) && writes(behind, write)),
        (Form::ReadFifo, fields) => fields.len() == 2,
        // Clause 6.21: read device ID codes 1 to 4, and an object.
        (Form::Tunnel, [MEI_DEVICE_IDENTIFICATION, fields @ ..]) => matches!(fields, [1..=4, _]),
        (Form::Tunnel, fields) => !fields.is_empty(),
        (Form::ReadFile | Form::WriteFile, []) => false,
    }
}

/// Address and a valid quantity.
fn reads(fields: &[u8], cells: Cells) -> bool {
    matches!(fields, [_, _, high, low] if (1..=cells.most).contains(&u16::from_be_bytes([*high, *low])))
}

/// Address, a valid quantity, and a byte count that agrees with the quantity and the length.
fn writes(fields: &[u8], cells: Cells) -> bool {
    let Some((head @ &[_, _, high, low], [count, data @ ..])) = fields.split_first_chunk() else {
        return false;
    };
    let bytes = cells.bytes(u16::from_be_bytes([high, low]));
    reads(head, cells) && usize::from(*count) == bytes && data.len() == bytes
}

/// One or more groups of function 21, each with a consistent length (clause 6.15).
fn file_groups(mut groups: &[u8]) -> bool {
    if groups.is_empty() {
        return false;
    }
    while let [_reference, _, _, _, _, high, low, data @ ..] = groups {
        let bytes = 2 * usize::from(u16::from_be_bytes([*high, *low]));
        match data.get(bytes..) {
            Some(rest) if bytes > 0 => groups = rest,
            _ => return false,
        }
    }
    groups.is_empty()
}

#[cfg(test)]
mod tests {
    use super::is_beyond_response;

    #[test]
    fn a_read_is_refused_for_its_length_when_no_response_holds_it() {
        for (request, beyond) in [
            ([3, 0, 0, 0, 125], false),
            ([3, 0, 0, 0, 126], true),
            ([4, 0, 0, 0xff, 0xff], true),
            ([1, 0, 0, 7, 0xd0], false),
            ([2, 0, 0, 7, 0xe1], true),
            ([3, 0, 0, 0, 0], false),
            ([16, 0, 0, 0, 126], false),
        ] {
            assert_eq!(is_beyond_response(&request), beyond, "{request:?}");
        }
    }
}
