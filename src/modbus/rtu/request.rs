//! Requests cut out of an RTU byte stream, in which no silence parts frames.
//!
//! A server calls [`request`] after every read with what nobody consumed yet, and [`request_at_pause`] when nothing has come
//! for a while: functions whose request has no length of its own are ended by the pause, and so is garbage.

use super::{FRAME_BYTES_MAX, OVERHEAD_BYTES, decode};
use crate::modbus::pdu::{EXCEPTION_BIT, request_length};

/// What stands at the front of the bytes received so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cut<'a> {
    /// Perhaps the beginning of a request: more bytes are needed, or a pause.
    Incomplete,
    /// A request with a good CRC.
    Request {
        /// The unit asked.
        unit: u8,
        /// Its PDU.
        pdu: &'a [u8],
        /// Bytes that it takes at the front of the buffer.
        consumed: usize,
    },
    /// Bytes that belong to no request.
    Noise {
        /// How many of them there are at the front of the buffer.
        consumed: usize,
    },
}

/// Looks at the front of `received`.
///
/// The first place at which a request can begin is decisive until it has proved wrong: by its CRC, or because more than
/// [`FRAME_BYTES_MAX`] bytes have come without a pause. So a longer buffer never gives [`Cut::Incomplete`].
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

/// Looks at the front of `received` when no more comes: a request whose length is unknown reaches to the end.
///
/// In garbage every 65536th CRC is right by chance, so requests of known length are looked for first.
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

/// The tails of `received` that begin as a request can: with a unit and a function code from 1 to 127.
fn starts(received: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let headers = received.windows(2).enumerate();
    let possible = headers.filter(|(_, header)| matches!(header, [_, 1..EXCEPTION_BIT]));
    possible.filter_map(|(at, _)| Some((at, received.get(at..)?)))
}

/// The frame that the function of `start` makes it, which may not be there as a whole; none when it would be too long.
fn whole(start: &[u8]) -> Option<Option<&[u8]>> {
    match request_length(start.get(1..).unwrap_or_default()) {
        None => Some(None),
        Some(length) if length + OVERHEAD_BYTES > FRAME_BYTES_MAX => None,
        Some(length) => Some(start.get(..length + OVERHEAD_BYTES)),
    }
}

/// The noise before a request is consumed first.
fn behind_noise(at: usize, unit: u8, pdu: &[u8], consumed: usize) -> Cut<'_> {
    if at == 0 { Cut::Request { unit, pdu, consumed } } else { Cut::Noise { consumed: at } }
}
