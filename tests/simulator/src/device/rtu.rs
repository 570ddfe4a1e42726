//! RTU frames by the letter of the specification: the CRC is computed bit by bit, Modbus over Serial Line 6.2.2.

/// CRC-16/MODBUS of `bytes`.
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xa001 } else { crc >> 1 })
    })
}

/// The frame of `pdu` from or to `unit`.
pub fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut frame = vec![unit];
    frame.extend_from_slice(pdu);
    let crc = crc16(&frame);
    frame.extend_from_slice(&crc.to_le_bytes());
    frame
}

/// Unit and PDU of `frame`, when its length and CRC are good.
pub fn open(frame: &[u8]) -> Option<(u8, &[u8])> {
    if !(4..=256).contains(&frame.len()) {
        return None;
    }
    let (body, crc) = frame.split_last_chunk()?;
    (crc16(body) == u16::from_le_bytes(*crc)).then(|| (body[0], &body[1..]))
}

#[cfg(test)]
mod tests {
    use super::{crc16, frame, open};

    #[test]
    fn the_crc_is_that_of_the_specifications_example() {
        // Modbus over Serial Line, appendix B: 02 07 gives 41 12 on the wire.
        assert_eq!(crc16(&[0x02, 0x07]), 0x1241);
        assert_eq!(frame(2, &[7]), [0x02, 0x07, 0x41, 0x12]);
    }

    #[test]
    fn a_frame_opens_only_intact() {
        let mut bytes = frame(17, &[3, 0, 1]);
        assert_eq!(open(&bytes), Some((17, &[3, 0, 1][..])));
        bytes[2] ^= 4;
        assert_eq!(open(&bytes), None);
    }
}
