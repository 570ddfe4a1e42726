//! Exceptions: the responses that say why there is no other one.

use core::fmt;

/// Set in the function code of a response that is an exception.
pub const EXCEPTION_BIT: u8 = 0x80;

/// An exception code: a response, not an error (Application Protocol V1.1b3, clause 7).
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
    /// 0B: the unit gave no valid response.
    pub const GATEWAY_NO_RESPONSE: Self = Self(0x0B);

    /// The response PDU that carries this exception as the response to `function`.
    pub const fn response(self, function: u8) -> [u8; 2] {
        [function | EXCEPTION_BIT, self.0]
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
