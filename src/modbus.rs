//! Modbus codecs: pure functions from slices to values, without time or I/O.
//!
//! A request received by TCP is split off the stream by [`tcp::parse`], validated by [`pdu::check_request`], and encoded for a
//! serial line by [`rtu::encode`] or [`ascii::encode`]. On a line, [`rtu::response`] after every read and
//! [`rtu::response_at_silence`] once the line is silent (or [`ascii::Decoder`] and [`pdu::fits`]) find the response among noise and
//! other frames; [`tcp::encode`] wraps it.
//!
//! The *PDU* (function code and data) is common to all framings; the gateway passes it through unchanged, including unknown
//! function codes.

use heapless::Vec;

#[doc(hidden)] // Public for tests/ only.
pub mod ascii;
#[doc(hidden)] // Public for tests/ only.
pub mod crc;
#[doc(hidden)] // Public for tests/ only.
pub mod delta;
mod exception;
#[doc(hidden)] // Public for tests/ only.
pub mod pdu;
pub mod rtu;
pub mod tcp;

pub use self::exception::Exception;

/// Longest PDU in bytes (Application Protocol V1.1b3, clause 4.1): the 256 of an RTU frame less unit and CRC.
pub const PDU_BYTES_MAX: usize = 253;

/// A PDU: function code and data.
pub type Pdu = Vec<u8, PDU_BYTES_MAX>;

/// A PDU that no framing can carry, with its length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a PDU has 1 to {PDU_BYTES_MAX} bytes, not {0}")]
pub struct PduLength(pub usize);

impl PduLength {
    /// Returns `pdu` if a frame can carry it.
    const fn check(pdu: &[u8]) -> Result<&[u8], Self> {
        if pdu.is_empty() || pdu.len() > PDU_BYTES_MAX { Err(Self(pdu.len())) } else { Ok(pdu) }
    }
}
