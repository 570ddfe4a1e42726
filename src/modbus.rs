//! Modbus codecs: pure functions from slices to values, without time, input or output.
//!
//! A request that came in by TCP is cut out of the stream by [`tcp::parse`], looked through by [`pdu::check_request`], and
//! written to a serial line by [`rtu::encode`] or [`ascii::encode`]. What the line brings back is told apart from noise
//! and from answers to somebody else by [`rtu::response`] after every read and [`rtu::response_at_silence`] when
//! the line falls silent (or by [`ascii::Decoder`] and [`pdu::fits`]); [`tcp::encode`] wraps the response.
//!
//! The *PDU* (function code and data) is what all framings share; the gateway passes it through unchanged, also
//! when it does not know the function code.

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

/// Longest PDU in bytes (Application Protocol V1.1b3, clause 4.1): 256 of an RTU frame less unit and CRC.
pub const PDU_BYTES_MAX: usize = 253;

/// A PDU: function code and data.
pub type Pdu = Vec<u8, PDU_BYTES_MAX>;

/// A PDU that no framing can carry; the fact is its length in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a PDU has 1 to {PDU_BYTES_MAX} bytes, not {0}")]
pub struct PduLength(pub usize);

impl PduLength {
    /// Gives `pdu` back when a frame can carry it.
    const fn check(pdu: &[u8]) -> Result<&[u8], Self> {
        if pdu.is_empty() || pdu.len() > PDU_BYTES_MAX { Err(Self(pdu.len())) } else { Ok(pdu) }
    }
}
