//! Validation of requests, before they take up a device's time.

use super::function::{
    DIAGNOSTICS, ENCAPSULATED_INTERFACE, GET_COMM_EVENT_COUNTER, GET_COMM_EVENT_LOG, MASK_WRITE_REGISTER,
    MEI_DEVICE_IDENTIFICATION, READ_COILS, READ_DISCRETE_INPUTS, READ_EXCEPTION_STATUS, READ_FIFO_QUEUE,
    READ_FILE_RECORD, READ_HOLDING_REGISTERS, READ_INPUT_REGISTERS, READ_WRITE_MULTIPLE_REGISTERS,
    REPORT_SERVER_ID, WRITE_FILE_RECORD, WRITE_MULTIPLE_COILS, WRITE_MULTIPLE_REGISTERS, WRITE_SINGLE_COIL,
    WRITE_SINGLE_REGISTER,
};
use super::{ResponseLength, file_response_length, response_length};
use crate::modbus::{Exception, PDU_BYTES_MAX};

/// Most coils or inputs in one read.
pub(super) const READ_BITS_MAX: u16 = 2000;
/// Most registers in one read.
pub(super) const READ_REGISTERS_MAX: u16 = 125;
/// Most coils in one write.
const WRITE_BITS_MAX: u16 = 1968;
/// Most registers in one write.
const WRITE_REGISTERS_MAX: u16 = 123;
/// Bits of a register.
const REGISTER_BITS: usize = 16;
/// Most registers written by function 23, whose header is longer.
const READ_WRITE_REGISTERS_MAX: u16 = 121;

/// Whether a server could accept this request; if not, the exception that it gets.
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
    if pdu.len() <= PDU_BYTES_MAX && possible(function, fields) {
        Ok(())
    } else {
        Err(Exception::ILLEGAL_VALUE)
    }
}

/// Whether `request` is a read whose response would not fit a PDU.
pub(crate) fn is_beyond_response(request: &[u8]) -> bool {
    let is_read = matches!(request, [READ_COILS..=READ_INPUT_REGISTERS, ..]);
    // A read's response length depends on the request only, so the request serves for both.
    let length = response_length(request, request);
    is_read && matches!(length, ResponseLength::Known(length) if length > PDU_BYTES_MAX)
}

/// The length of the request beginning with `so_far`, including the function code, where its function determines it; a frame of
/// another length is not a request.
pub fn request_length(so_far: &[u8]) -> Option<usize> {
    let counted = |at: usize| Some(at + 1 + usize::from(*so_far.get(at)?));
    match so_far {
        [
            READ_COILS
            | READ_DISCRETE_INPUTS
            | READ_HOLDING_REGISTERS
            | READ_INPUT_REGISTERS
            | WRITE_SINGLE_COIL
            | WRITE_SINGLE_REGISTER,
            ..,
        ] => Some(5),
        [READ_EXCEPTION_STATUS | GET_COMM_EVENT_COUNTER | GET_COMM_EVENT_LOG | REPORT_SERVER_ID, ..] => {
            Some(1)
        }
        [DIAGNOSTICS, 0, 1..=4 | 10..=18 | 20, ..] => Some(5),
        [WRITE_MULTIPLE_COILS | WRITE_MULTIPLE_REGISTERS, ..] => counted(5),
        [READ_FILE_RECORD | WRITE_FILE_RECORD, ..] => counted(1),
        [MASK_WRITE_REGISTER, ..] => Some(7),
        [READ_WRITE_MULTIPLE_REGISTERS, ..] => counted(9),
        [READ_FIFO_QUEUE, ..] => Some(3),
        [ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, ..] => Some(4),
        _ => None,
    }
}

/// Whether `fields`, the bytes after the function code, are valid for `function`.
fn possible(function: u8, fields: &[u8]) -> bool {
    match (function, fields) {
        (READ_COILS | READ_DISCRETE_INPUTS, fields) => reads(fields, READ_BITS_MAX),
        (READ_HOLDING_REGISTERS | READ_INPUT_REGISTERS, fields) => reads(fields, READ_REGISTERS_MAX),
        (WRITE_SINGLE_COIL, fields) => matches!(fields, [_, _, 0x00 | 0xFF, 0x00]),
        (WRITE_SINGLE_REGISTER, fields) => fields.len() == 4,
        (READ_EXCEPTION_STATUS | GET_COMM_EVENT_COUNTER | GET_COMM_EVENT_LOG | REPORT_SERVER_ID, fields) => {
            fields.is_empty()
        }
        // Data has two bytes or, for sub-function 0, "N x 2"; some devices accept any, so let them judge.
        (DIAGNOSTICS, fields) => fields.len() >= 2,
        (WRITE_MULTIPLE_COILS, fields) => writes(fields, WRITE_BITS_MAX, 1),
        (WRITE_MULTIPLE_REGISTERS, fields) => writes(fields, WRITE_REGISTERS_MAX, REGISTER_BITS),
        (READ_FILE_RECORD, [count, groups @ ..]) => {
            usize::from(*count) == groups.len() && file_response_length(groups).is_some()
        }
        (WRITE_FILE_RECORD, [count, groups @ ..]) => {
            usize::from(*count) == groups.len() && file_groups(groups)
        }
        (MASK_WRITE_REGISTER, fields) => fields.len() == 6,
        (READ_WRITE_MULTIPLE_REGISTERS, fields) => fields.split_at_checked(4).is_some_and(|(read, write)| {
            reads(read, READ_REGISTERS_MAX) && writes(write, READ_WRITE_REGISTERS_MAX, REGISTER_BITS)
        }),
        (READ_FIFO_QUEUE, fields) => fields.len() == 2,
        // Clause 6.21: read device ID codes 1 to 4, and an object.
        (ENCAPSULATED_INTERFACE, [MEI_DEVICE_IDENTIFICATION, fields @ ..]) => matches!(fields, [1..=4, _]),
        (ENCAPSULATED_INTERFACE | READ_FILE_RECORD | WRITE_FILE_RECORD, fields) => !fields.is_empty(),
        _ => true,
    }
}

/// Address and a quantity from 1 to `max`.
fn reads(fields: &[u8], max: u16) -> bool {
    matches!(fields, [_, _, high, low] if (1..=max).contains(&u16::from_be_bytes([*high, *low])))
}

/// Address, a quantity from 1 to `max`, and a byte count that agrees with the quantity of `bits` each and with the length.
fn writes(fields: &[u8], max: u16, bits: usize) -> bool {
    let Some((head @ &[_, _, high, low], [count, data @ ..])) = fields.split_first_chunk() else {
        return false;
    };
    let bytes = (usize::from(u16::from_be_bytes([high, low])) * bits).div_ceil(8);
    reads(head, max) && usize::from(*count) == bytes && data.len() == bytes
}

/// One or more groups of function 21, each as long as it says (clause 6.15).
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
    fn a_read_is_refused_for_its_length_when_no_answer_holds_it() {
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
