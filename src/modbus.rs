//! Modbus codecs: pure functions from slices to values, without time, input or output.
//!
//! A request that came in by TCP is cut out of the stream by [`tcp::parse`], looked through by [`pdu::check_request`], and
//! written to a serial line by [`rtu::encode`] or [`ascii::encode`]. What the line brings back is told apart from noise
//! and from answers to somebody else by [`rtu::response`] after every read and [`rtu::response_at_silence`] when
//! the line falls silent (or by [`ascii::Decoder`] and [`pdu::fits`]); [`tcp::encode`] wraps the answer.
//!
//! The *PDU* (function code and data) is what all framings share; the gateway passes it through unchanged, also
//! when it does not know the function code.

use core::fmt;

use heapless::Vec;

pub mod ascii;
pub mod crc;
pub mod delta;
pub mod pdu;
pub mod rtu;
pub mod tcp;

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

/// An exception code: an answer, not an error (Application Protocol V1.1b3, clause 7).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Exception(pub u8);

impl Exception {
    /// 01: the function is not allowed, or refused by policy.
    pub const ILLEGAL_FUNCTION: Self = Self(0x01);
    /// 02: the device has no such address.
    pub const ILLEGAL_ADDRESS: Self = Self(0x02);
    /// 03: a length, quantity or value that the function cannot have.
    pub const ILLEGAL_VALUE: Self = Self(0x03);
    /// 04: the device failed while acting.
    pub const DEVICE_FAILURE: Self = Self(0x04);
    /// 05: accepted, will take long.
    pub const ACKNOWLEDGE: Self = Self(0x05);
    /// 06: busy, ask again later.
    pub const BUSY: Self = Self(0x06);
    /// 0A: the gateway has no way to the unit.
    pub const GATEWAY_NO_PATH: Self = Self(0x0A);
    /// 0B: the unit gave no valid answer.
    pub const GATEWAY_NO_RESPONSE: Self = Self(0x0B);

    /// The response PDU that carries this exception as the answer to `function`.
    pub const fn response(self, function: u8) -> [u8; 2] {
        [function | pdu::EXCEPTION_BIT, self.0]
    }
}

impl fmt::Display for Exception {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match *self {
            Self::ILLEGAL_FUNCTION => "illegal function",
            Self::ILLEGAL_ADDRESS => "illegal data address",
            Self::ILLEGAL_VALUE => "illegal data value",
            Self::DEVICE_FAILURE => "server device failure",
            Self::ACKNOWLEDGE => "acknowledge",
            Self::BUSY => "server device busy",
            Self(0x08) => "memory parity error",
            Self::GATEWAY_NO_PATH => "gateway path unavailable",
            Self::GATEWAY_NO_RESPONSE => "gateway target device failed to respond",
            Self(_) => "exception",
        };
        write!(f, "{name} ({:02X}h)", self.0)
    }
}
