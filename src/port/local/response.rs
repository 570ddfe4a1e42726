//! Building blocks of the own unit's responses.

use crate::modbus::{Exception, Pdu};

/// `Ok` if there is a response; otherwise the exception to respond with.
pub(super) type Answered = Result<(), Exception>;

/// Appends `parts` to `response`.
pub(super) fn put(response: &mut Pdu, parts: &[&[u8]]) -> Answered {
    let written = parts.iter().try_for_each(|part| response.extend_from_slice(part));
    written.map_err(|_| Exception::DEVICE_FAILURE)
}
