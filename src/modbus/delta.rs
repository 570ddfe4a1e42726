//! The CRC of a frame whose unit id is changed while it passes, though nobody knows yet whether the frame is good.
//!
//! A CRC computed anew would make a damaged frame a valid one. But CRCs are linear: that of a frame with another unit id
//! differs from the old one by the CRC of the difference, which is `in ^ out` and zeros behind it, from a register that starts
//! at zero. So what was valid stays valid, and what was damaged stays damaged by the same bits.

use crc::Digest;

use super::crc::MODBUS;

/// What the CRC of the characters so far changes by.
#[derive(Clone)]
pub struct CrcDelta(Digest<'static, u16>);

impl CrcDelta {
    /// Behind the unit id, which was `from` and is sent as `to`.
    pub fn new(from: u8, to: u8) -> Self {
        let mut register = MODBUS.digest_with_initial(0);
        register.update(&[from ^ to]);
        Self(register)
    }

    /// `count` characters further, which are sent as they came.
    pub fn pass(&mut self, count: usize) {
        if !self.is_none() {
            (0..count).for_each(|_| self.0.update(&[0]));
        }
    }

    /// Whether nothing changes: nothing will either.
    fn is_none(&self) -> bool {
        self.0.clone().finalize() == 0
    }

    /// The CRC to send, low byte first, in place of `received`.
    pub fn translate(&self, received: [u8; 2]) -> [u8; 2] {
        let delta = self.0.clone().finalize();
        (u16::from_le_bytes(received) ^ delta).to_le_bytes()
    }
}
