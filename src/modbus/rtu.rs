//! RTU framing: unit, PDU, CRC, ended by silence; and the search for the response in what a line brings.
//!
//! A client calls [`response`] after every read with everything that came since its request left: a response whose length can
//! be known ends the wait as soon as it is whole. When the line fell silent for t3.5 it calls
//! [`response_at_silence`], which also sees responses whose end only the silence tells, and says what else came.

use super::crc::{MODBUS, crc16};
use super::pdu::{EXCEPTION_BIT, Misfit, ResponseLength, fits, response_length};
use super::{PDU_BYTES_MAX, PduLength};

mod request;

pub use request::{Cut, request, request_at_pause};

/// Longest frame in bytes (Serial Line V1.02, clause 2.5.1).
pub const FRAME_BYTES_MAX: usize = 256;
/// Shortest frame in bytes: unit, function code, CRC.
pub const FRAME_BYTES_MIN: usize = 4;

/// Bytes of a frame that are not the PDU's: unit and CRC.
pub(crate) const OVERHEAD_BYTES: usize = FRAME_BYTES_MAX - PDU_BYTES_MAX;

/// Why bytes are no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum RtuError {
    /// Fewer bytes than a frame can have.
    #[error("frame of {0} bytes, {FRAME_BYTES_MIN} at least")]
    Short(usize),
    /// More bytes than a frame can have.
    #[error("frame of {0} bytes, {FRAME_BYTES_MAX} at most")]
    Long(usize),
    /// The frame was damaged.
    #[error("CRC {received:04X}h, computed {computed:04X}h")]
    Crc {
        /// What the frame says.
        received: u16,
        /// What its bytes give.
        computed: u16,
    },
}

/// Writes the frame of `unit` and `pdu` into `out` and gives the part that it takes.
pub fn encode<'a>(unit: u8, pdu: &[u8], out: &'a mut [u8; FRAME_BYTES_MAX]) -> Result<&'a [u8], PduLength> {
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

/// Unit and PDU of a whole frame.
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

/// Where the frame of `pdu`, a part of `received`, ends in that.
pub(crate) fn end_of(pdu: &[u8], received: &[u8]) -> usize {
    let before = pdu.as_ptr().addr() - received.as_ptr().addr();
    before + pdu.len() + OVERHEAD_BYTES - 1
}

/// What [`response`] found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Received<'a> {
    /// The response PDU: unit, function, length and CRC are right, and it fits the request.
    Complete(&'a [u8]),
    /// Nothing yet: read on, until the silence.
    Partial,
}

/// What [`response_at_silence`] found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AtSilence<'a> {
    /// The response PDU: the CRC is right, and it fits the request.
    Complete(&'a [u8]),
    /// A good frame of another unit, with its PDU. The response is still awaited (Serial Line V1.02, clause 2.4.1).
    WrongUnit(u8, &'a [u8]),
    /// A good frame of our unit, with its PDU, that does not answer this request: perhaps a late response to an earlier one.
    Misfit(Misfit, &'a [u8]),
    /// It begins as our response does, and its CRC is wrong: the response came, but damaged.
    Corrupt,
    /// It begins as our response does, and its end is missing.
    Short,
    /// Anything else.
    Noise,
}

/// Looks for `unit`'s response to the PDU `request` in everything `received` since the request left.
///
/// Bytes before and behind the response are skipped: drivers that switch the line make noise at both ends. The first place
/// at which a response can begin is decisive until it has proved wrong, so that data which looks like a frame is
/// not taken for one. Whatever is found in some bytes is also found in them with more behind: how a read cuts the
/// stream makes no difference. The CRC is computed only where unit, function and length are right.
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

/// Looks at everything `received` since the request left, when the line has fallen silent.
///
/// A frame that takes all of it is judged first. Otherwise the response may stand among noise, as in [`response`]; one
/// whose end only the silence tells must reach to the end.
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

/// The tails of `received` that begin with `unit` and the function of `request` or its exception.
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

/// What the bytes from a possible start on can be.
enum Candidate<'a> {
    /// A frame of the length that the response must have; what is behind it is cut off.
    Whole(&'a [u8]),
    /// The beginning of a frame: its end is missing.
    Begun,
    /// A frame whose end only the silence tells.
    Open(&'a [u8]),
    /// No frame: it would be longer than frames are.
    Impossible,
}

/// Tells what `start`, which begins with the right unit and function, can be as far as its length goes.
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

/// The PDU of `frame` when its CRC is right and it fits the request.
fn matching_pdu<'a>(request: &[u8], frame: &'a [u8]) -> Option<&'a [u8]> {
    let (_, pdu) = decode(frame).ok()?;
    fits(request, pdu).is_ok().then_some(pdu)
}
