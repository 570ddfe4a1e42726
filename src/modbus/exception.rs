//! Exceptions: responses that report why a request failed.

use core::fmt;

/// Set in the function code of an exception.
pub const EXCEPTION_BIT: u8 = 0x80;

/// An exception code: a response, not an error (Application Protocol V1.1b3, clause 7).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Exception(pub u8);

impl Exception {
    /// 01: the function is not allowed, or refused by policy.
    pub const ILLEGAL_FUNCTION: Self = Self(0x01);
    /// 02: the address does not exist in the device.
    pub const ILLEGAL_ADDRESS: Self = Self(0x02);
    /// 03: an invalid length, quantity or value.
    pub const ILLEGAL_VALUE: Self = Self(0x03);
    /// 04: the device failed during execution.
    pub const DEVICE_FAILURE: Self = Self(0x04);
    /// 05: accepted, but execution takes long.
    pub const ACKNOWLEDGE: Self = Self(0x05);
    /// 06: busy, try again later.
    pub const BUSY: Self = Self(0x06);
    /// 0A: the gateway has no path to the unit.
    pub const GATEWAY_NO_PATH: Self = Self(0x0A);
    /// 0B: no valid response from the unit.
    pub const GATEWAY_NO_RESPONSE: Self = Self(0x0B);

    /// The PDU of this exception in response to `function`.
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
