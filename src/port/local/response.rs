//! The response of the own unit, as it is written.

use crate::modbus::{Exception, Pdu};

/// Whether there is a response, or which exception is the response.
pub(super) type Answered = Result<(), Exception>;

/// Appends `parts` to `response`.
pub(super) fn put(response: &mut Pdu, parts: &[&[u8]]) -> Answered {
    let written = parts.iter().try_for_each(|part| response.extend_from_slice(part));
    written.map_err(|_| Exception::DEVICE_FAILURE)
}
