//! Modbus TCP framing: the MBAP header before the PDU, and how frames are split off a stream.
//!
//! Clauses are those of the Messaging on TCP/IP Implementation Guide V1.0b.

use super::PduLength;

/// Longest frame in bytes (clause 3.1.3): header and [`PDU_BYTES_MAX`](super::PDU_BYTES_MAX).
pub const ADU_BYTES_MAX: usize = 260;

/// Bytes up to the end of the length field, which counts what follows.
const PREFIX_BYTES: usize = 6;
/// Bytes before the PDU.
pub(crate) const HEADER_BYTES: usize = 7;
/// Valid lengths: the unit, and a PDU of 1 to 253 bytes.
const LENGTH: core::ops::RangeInclusive<u16> = 2..=254;

/// The variable header fields; the response repeats the request's (clause 3.1.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Header {
    /// Matches a response to its request.
    pub transaction: u16,
    /// The unit behind the gateway, or 255 or 0 for the TCP device itself.
    pub unit: u8,
}

/// The item at the front of the bytes received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parsed<'a> {
    /// The beginning of a frame: more bytes are needed.
    Incomplete,
    /// A frame.
    Frame {
        /// Its header.
        header: Header,
        /// Its PDU, 1 to 253 bytes.
        pdu: &'a [u8],
        /// Bytes to consume.
        consumed: usize,
    },
    /// A frame of another protocol: to be dropped without response, the connection stays open (clause 4.4.2.1).
    Skip {
        /// Bytes to consume.
        consumed: usize,
    },
}

/// Why a stream cannot be decoded any further: the connection must be closed, since nothing marks the next frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MbapError {
    /// An invalid length field; 2 to 254 are valid.
    #[error("MBAP length {0}, not 2 to 254")]
    Length(u16),
}

/// Examines the front of `buffer`, the bytes not consumed yet.
///
/// A full buffer of [`ADU_BYTES_MAX`] bytes never yields [`Parsed::Incomplete`]. An invalid length is detected as soon as its two
/// bytes have arrived.
pub fn parse(buffer: &[u8]) -> Result<Parsed<'_>, MbapError> {
    let [transaction_high, transaction_low, protocol_high, protocol_low, length_high, length_low, rest @ ..] =
        buffer
    else {
        return Ok(Parsed::Incomplete);
    };
    let length = u16::from_be_bytes([*length_high, *length_low]);
    if !LENGTH.contains(&length) {
        return Err(MbapError::Length(length));
    }
    let Some([unit, pdu @ ..]) = rest.get(..usize::from(length)) else {
        return Ok(Parsed::Incomplete);
    };
    let consumed = PREFIX_BYTES + usize::from(length);
    if [*protocol_high, *protocol_low] != [0, 0] {
        return Ok(Parsed::Skip { consumed });
    }
    let transaction = u16::from_be_bytes([*transaction_high, *transaction_low]);
    Ok(Parsed::Frame { header: Header { transaction, unit: *unit }, pdu, consumed })
}

/// Whether `bytes`, as far as they have arrived, may begin a frame with this transaction id.
pub(crate) fn may_begin(transaction: u16, bytes: &[u8]) -> bool {
    let [high, low] = transaction.to_be_bytes();
    let head = [high, low, 0, 0, 0];
    let known = bytes.len().min(head.len());
    let has_length = |length: &u8| LENGTH.contains(&u16::from(*length));
    head.get(..known) == bytes.get(..known) && bytes.get(head.len()).is_none_or(has_length)
}

/// Encodes the frame of `pdu` into `out`, which has room for it, and returns the part used.
pub fn encode<'a>(header: Header, pdu: &[u8], out: &'a mut [u8]) -> Result<&'a [u8], PduLength> {
    let pdu = PduLength::check(pdu)?;
    let [transaction_high, transaction_low] = header.transaction.to_be_bytes();
    let [length_high, length_low] = (pdu.len() as u16 + 1).to_be_bytes();
    let no_room = PduLength(pdu.len());
    let frame = out.get_mut(..HEADER_BYTES + pdu.len()).ok_or(no_room)?;
    let (head, body) = frame.split_first_chunk_mut().ok_or(no_room)?;
    *head = [transaction_high, transaction_low, 0, 0, length_high, length_low, header.unit];
    body.copy_from_slice(pdu);
    Ok(frame)
}
