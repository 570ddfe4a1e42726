//! Corrects the CRC of a frame whose unit id is translated during cut-through, before the frame has been validated.
//!
//! Computing a new CRC would make a corrupt frame valid. But CRCs are linear: with another unit id, the CRC changes by the CRC of
//! the difference, which is `in ^ out` followed by zeros, with an initial register of zero. So a valid frame stays valid, and a
//! corrupt one stays corrupt in the same bits.

use crc::Digest;

use super::crc::MODBUS;

/// The change of the CRC over the characters so far.
#[derive(Clone)]
pub struct CrcDelta(Digest<'static, u16>);

impl CrcDelta {
    /// The change after the unit id, which is translated from `from` to `to`.
    pub fn new(from: u8, to: u8) -> Self {
        let mut register = MODBUS.digest_with_initial(0);
        register.update(&[from ^ to]);
        Self(register)
    }

    /// Advances by `count` more characters, which are sent unchanged.
    pub fn pass(&mut self, count: usize) {
        if !self.is_none() {
            (0..count).for_each(|_| self.0.update(&[0]));
        }
    }

    /// Whether the CRC is unchanged, and will stay so.
    fn is_none(&self) -> bool {
        self.0.clone().finalize() == 0
    }

    /// The CRC to send, low byte first, in place of `received`.
    pub fn translate(&self, received: [u8; 2]) -> [u8; 2] {
        let delta = self.0.clone().finalize();
        (u16::from_le_bytes(received) ^ delta).to_le_bytes()
    }
}
