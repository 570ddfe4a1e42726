//! RTU framing: unit, PDU, CRC, ended by silence; and the search for a response in the bytes received.
//!
//! A client calls [`response`] after every read, with all bytes since the request: a response whose length is known is complete at
//! its last byte. When the line has been silent for t3.5 the client calls [`response_at_silence`], which also accepts responses
//! that only silence ends, and classifies everything else.

use super::crc::{MODBUS, crc16};
use super::pdu::{EXCEPTION_BIT, Misfit, ResponseLength, fits, response_length};
use super::{PDU_BYTES_MAX, PduLength};

mod request;

pub use request::{Cut, request, request_at_pause};

/// Longest frame in bytes (Serial Line V1.02, clause 2.5.1).
pub const FRAME_BYTES_MAX: usize = 256;
/// Shortest frame in bytes: unit, function code, CRC.
pub(crate) const FRAME_BYTES_MIN: usize = 4;

/// Bytes of a frame besides the PDU: unit and CRC.
pub(crate) const OVERHEAD_BYTES: usize = FRAME_BYTES_MAX - PDU_BYTES_MAX;

/// Why bytes are not a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum RtuError {
    /// Fewer bytes than a frame can have.
    #[error("frame of {0} bytes, {FRAME_BYTES_MIN} at least")]
    Short(usize),
    /// More bytes than a frame can have.
    #[error("frame of {0} bytes, {FRAME_BYTES_MAX} at most")]
    Long(usize),
    /// The frame is corrupt.
    #[error("CRC {received:04X}h, computed {computed:04X}h")]
    Crc {
        /// The CRC received.
        received: u16,
        /// The CRC of its bytes.
        computed: u16,
    },
}

/// Encodes `unit` and `pdu` into `out`, which has room for them, and returns the part used.
pub fn encode<'a>(unit: u8, pdu: &[u8], out: &'a mut [u8]) -> Result<&'a [u8], PduLength> {
    let pdu = PduLength::check(pdu)?;
    let no_room = PduLength(pdu.len());
    let frame = out.get_mut(..pdu.len() + OVERHEAD_BYTES).ok_or(no_room)?;
    let (content, crc) = frame.split_last_chunk_mut().ok_or(no_room)?;
    let (first, body) = content.split_first_mut().ok_or(no_room)?;
    *first = unit;
    body.copy_from_slice(pdu);
    *crc = crc16(content).to_le_bytes();
    Ok(frame)
}

/// The CRC of a frame of `unit` and `pdu`.
pub(crate) fn check(unit: u8, pdu: &[u8]) -> u16 {
    let mut crc = MODBUS.digest();
    crc.update(&[unit]);
    crc.update(pdu);
    crc.finalize()
}

/// Unit and PDU of a complete frame.
pub fn decode(frame: &[u8]) -> Result<(u8, &[u8]), RtuError> {
    if frame.len() > FRAME_BYTES_MAX {
        return Err(RtuError::Long(frame.len()));
    }
    let short = RtuError::Short(frame.len());
    let Some((content, received)) = frame.split_last_chunk() else { return Err(short) };
    let [unit, pdu @ ..] = content else { return Err(short) };
    if pdu.is_empty() {
        return Err(short);
    }
    let received = u16::from_le_bytes(*received);
    let computed = crc16(content);
    if received != computed {
        return Err(RtuError::Crc { received, computed });
    }
    Ok((*unit, pdu))
}

/// The end of the frame of `pdu`, which is a slice of `received`.
pub(crate) fn end_of(pdu: &[u8], received: &[u8]) -> usize {
    let before = pdu.as_ptr().addr() - received.as_ptr().addr();
    before + pdu.len() + OVERHEAD_BYTES - 1
}

/// The result of [`response`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received<'a> {
    /// The response's PDU: unit, function, length and CRC are right, and it matches the request.
    Complete(&'a [u8]),
    /// Nothing yet: read on, until silence.
    Partial,
}

/// The result of [`response_at_silence`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AtSilence<'a> {
    /// The response's PDU: the CRC is right, and it matches the request.
    Complete(&'a [u8]),
    /// A valid frame of another unit, with its PDU. The response is still expected (Serial Line V1.02, clause 2.4.1).
    WrongUnit(u8, &'a [u8]),
    /// A valid frame of the unit, with its PDU, that does not match the request: perhaps a late response to an earlier one.
    Misfit(Misfit, &'a [u8]),
    /// It begins like the response, but its CRC is wrong.
    Corrupt,
    /// It begins like the response, but is truncated.
    Short,
    /// Anything else.
    Noise,
}

/// Searches all bytes `received` since the request for the response of `unit` to `request`.
///
/// Bytes before and after the response are skipped, as drivers generate noise when they switch the line. The first position at
/// which a response can begin has precedence until it proves wrong, so that data that looks like a frame is not taken for one. The
/// result does not depend on how reads split the bytes: a response found in some bytes is also found when more follow. The CRC is
/// computed only where unit, function and length are right.
pub fn response<'a>(unit: u8, request: &[u8], received: &'a [u8]) -> Received<'a> {
    for start in starts(unit, request, received) {
        match candidate(request, start) {
            Candidate::Whole(frame) => {
                if let Some(pdu) = matching_pdu(request, frame) {
                    return Received::Complete(pdu);
                }
            }
            Candidate::Begun | Candidate::Open(_) => return Received::Partial,
            Candidate::Impossible => {}
        }
    }
    Received::Partial
}

/// Classifies all bytes `received` since the request, once the line is silent.
///
/// A frame that covers all bytes is checked first. Otherwise the response may be surrounded by noise, as in [`response`]; one that
/// only silence ends must extend to the end.
pub fn response_at_silence<'a>(unit: u8, request: &[u8], received: &'a [u8]) -> AtSilence<'a> {
    if let Ok((from, pdu)) = decode(received) {
        return match fits(request, pdu) {
            _ if from != unit => AtSilence::WrongUnit(from, pdu),
            Ok(()) => AtSilence::Complete(pdu),
            Err(misfit) => AtSilence::Misfit(misfit, pdu),
        };
    }
    for start in starts(unit, request, received) {
        let found = match candidate(request, start) {
            Candidate::Whole(frame) | Candidate::Open(frame) => matching_pdu(request, frame),
            Candidate::Begun | Candidate::Impossible => None,
        };
        if let Some(pdu) = found {
            return AtSilence::Complete(pdu);
        }
    }
    match starts(unit, request, received).next() {
        Some(start) if start.len() < received.len() => AtSilence::Noise,
        Some(start) if matches!(candidate(request, start), Candidate::Begun) => AtSilence::Short,
        Some(_) => AtSilence::Corrupt,
        None => AtSilence::Noise,
    }
}

/// The suffixes of `received` that begin with `unit` and the function of `request` or its exception.
fn starts<'a>(unit: u8, request: &[u8], received: &'a [u8]) -> impl Iterator<Item = &'a [u8]> {
    let function = request.first().copied();
    let headers = received.windows(2).enumerate();
    headers.filter_map(move |(at, header)| match header {
        [from, answered] if *from == unit && Some(*answered & !EXCEPTION_BIT) == function => {
            received.get(at..)
        }
        _ => None,
    })
}

/// Possible meanings of the bytes from a possible start.
enum Candidate<'a> {
    /// A frame of the expected length; bytes after it are cut off.
    Whole(&'a [u8]),
    /// The beginning of a frame.
    Begun,
    /// A frame that only silence ends.
    Open(&'a [u8]),
    /// No frame: it would be too long.
    Impossible,
}

/// Classifies `start`, which begins with the right unit and function, by length.
fn candidate<'a>(request: &[u8], start: &'a [u8]) -> Candidate<'a> {
    let frame_bytes = match response_length(request, start.get(1..).unwrap_or_default()) {
        ResponseLength::Known(length) if length > PDU_BYTES_MAX => return Candidate::Impossible,
        ResponseLength::Known(length) => length + OVERHEAD_BYTES,
        ResponseLength::More => return Candidate::Begun,
        ResponseLength::Silence if start.len() > FRAME_BYTES_MAX => return Candidate::Impossible,
        ResponseLength::Silence => return Candidate::Open(start),
    };
    start.get(..frame_bytes).map_or(Candidate::Begun, Candidate::Whole)
}

/// The PDU of `frame` if its CRC is right and it matches the request.
fn matching_pdu<'a>(request: &[u8], frame: &'a [u8]) -> Option<&'a [u8]> {
    let (_, pdu) = decode(frame).ok()?;
    fits(request, pdu).is_ok().then_some(pdu)
}
