//! Splits requests off an RTU byte stream, where no silence separates frames.
//!
//! A server calls [`request`] after every read with the bytes not consumed yet, and [`request_at_pause`] after a pause, which
//! ends garbage, and requests whose function does not determine their length.

use super::{FRAME_BYTES_MAX, OVERHEAD_BYTES, decode};
use crate::modbus::pdu::{EXCEPTION_BIT, request_length};

/// The item at the front of the bytes received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cut<'a> {
    /// Possibly the beginning of a request: wait for more bytes, or a pause.
    Incomplete,
    /// A request with a valid CRC.
    Request {
        /// The unit asked.
        unit: u8,
        /// Its PDU.
        pdu: &'a [u8],
        /// Bytes to consume.
        consumed: usize,
    },
    /// Bytes that are not part of a request.
    Noise {
        /// Bytes to consume.
        consumed: usize,
    },
}

/// Examines the front of `received`.
///
/// The first position at which a request can begin has precedence until it proves wrong: by its CRC, or because more than
/// [`FRAME_BYTES_MAX`] bytes have arrived without a pause. So a longer buffer never yields [`Cut::Incomplete`].
pub fn request(received: &[u8]) -> Cut<'_> {
    for (at, start) in starts(received) {
        match whole(start) {
            Some(Some(frame)) => {
                if let Ok((unit, pdu)) = decode(frame) {
                    return behind_noise(at, unit, pdu, frame.len());
                }
            }
            Some(None) if start.len() > FRAME_BYTES_MAX => {}
            Some(None) if at > 0 => return Cut::Noise { consumed: at },
            Some(None) => return Cut::Incomplete,
            None => {}
        }
    }
    // The last byte may be a unit.
    match received.len() {
        0 | 1 => Cut::Incomplete,
        length => Cut::Noise { consumed: length - 1 },
    }
}

/// Examines the front of `received` after a pause: a request of unknown length extends to the end.
///
/// In garbage, one CRC in 65536 is right by chance, so requests of known length are tried first.
pub fn request_at_pause(received: &[u8]) -> Cut<'_> {
    for length_is_known in [true, false] {
        for (at, start) in starts(received) {
            let frame = match whole(start) {
                Some(Some(frame)) if length_is_known => frame,
                Some(None) if !length_is_known => start,
                _ => continue,
            };
            if let Ok((unit, pdu)) = decode(frame) {
                return behind_noise(at, unit, pdu, frame.len());
            }
        }
    }
    Cut::Noise { consumed: received.len() }
}

/// The suffixes of `received` that begin like a request: with a unit and a function code from 1 to 127.
fn starts(received: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let headers = received.windows(2).enumerate();
    let possible = headers.filter(|(_, header)| matches!(header, [_, 1..EXCEPTION_BIT]));
    possible.filter_map(|(at, _)| Some((at, received.get(at..)?)))
}

/// The frame at `start` by the length of its function, or `Some(None)` while it is incomplete; `None` if it would be too long.
fn whole(start: &[u8]) -> Option<Option<&[u8]>> {
    match request_length(start.get(1..).unwrap_or_default()) {
        None => Some(None),
        Some(length) if length + OVERHEAD_BYTES > FRAME_BYTES_MAX => None,
        Some(length) => Some(start.get(..length + OVERHEAD_BYTES)),
    }
}

/// Noise before a request is consumed first.
fn behind_noise(at: usize, unit: u8, pdu: &[u8], consumed: usize) -> Cut<'_> {
    if at == 0 { Cut::Request { unit, pdu, consumed } } else { Cut::Noise { consumed: at } }
}
