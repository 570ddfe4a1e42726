//! Read device identification (FC 2Bh, MEI type 0Eh), Application Protocol 6.21.

use super::response::{Answered, put};
use crate::modbus::pdu::function::{ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION};
use crate::modbus::{Exception, Pdu};

/// The objects by id: vendor, product code, revision, vendor URL, product name.
const OBJECTS: [&str; 5] = [
    env!("CARGO_PKG_NAME"),
    env!("CARGO_PKG_NAME"),
    env!("CARGO_PKG_VERSION"),
    env!("CARGO_PKG_REPOSITORY"),
    "mobgate Modbus gateway",
];
/// Number of basic objects.
const BASIC: usize = 3;
/// Regular identification, with stream and individual access.
const CONFORMITY: u8 = 0x82;

/// The objects from `first` on for read `code`: 1 basic, 2 and 3 all, 4 this one only. They fit into one response.
pub(super) fn respond(code: u8, first: u8, response: &mut Pdu) -> Answered {
    let end = match code {
        1 => BASIC,
        2 | 3 => OBJECTS.len(),
        4 => usize::from(first) + 1,
        _ => return Err(Exception::ILLEGAL_VALUE),
    };
    let first = usize::from(first);
    // A stream that would start with an unknown object starts with the first one (6.21).
    let start = if first < end { first } else { 0 };
    let objects = OBJECTS.get(start..end).ok_or(Exception::ILLEGAL_ADDRESS)?;
    let count = objects.len() as u8;
    let (more_follows, next) = (0, 0);
    let header =
        [ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, code, CONFORMITY, more_follows, next, count];
    put(response, &[&header])?;
    for (id, object) in objects.iter().enumerate() {
        put(response, &[&[(start + id) as u8, object.len() as u8], object.as_bytes()])?;
    }
    Ok(())
}
