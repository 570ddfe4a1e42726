//! The response of the own unit, as it is written.

use crate::modbus::{Exception, Pdu};

/// Whether there is an answer, or which exception is the answer.
pub(super) type Answered = Result<(), Exception>;

/// Appends `parts` to `answer`.
pub(super) fn put(answer: &mut Pdu, parts: &[&[u8]]) -> Answered {
    let written = parts.iter().try_for_each(|part| answer.extend_from_slice(part));
    written.map_err(|_| Exception::DEVICE_FAILURE)
}
