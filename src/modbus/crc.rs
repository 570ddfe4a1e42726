//! The two checks of the serial framings: CRC-16/MODBUS for RTU, the longitudinal redundancy check for ASCII.

use crc::{CRC_16_MODBUS, Crc};

/// The CRC table; a static, so that it stays in flash.
pub(crate) static MODBUS: Crc<u16> = Crc::<u16>::new(&CRC_16_MODBUS);

/// The CRC over an RTU frame's unit and PDU; sent low byte first (Serial Line V1.02, clause 6.2.2).
pub fn crc16(bytes: &[u8]) -> u16 {
    MODBUS.checksum(bytes)
}

/// The LRC over an ASCII frame's unit and PDU: the two's complement of their sum (Serial Line V1.02, clause 6.2.1).
pub fn lrc(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0u8, |sum, &byte| sum.wrapping_add(byte)).wrapping_neg()
}
