//! RTU frames: encoding, decoding and the CRC, also where the unit changes.

use mobgate::modbus::crc::crc16;
use mobgate::modbus::delta::CrcDelta;
use mobgate::modbus::rtu::{FRAME_BYTES_MAX, RtuError, decode, encode};

use crate::prelude::*;
use crate::samples::any_pdu;

pub(crate) fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    encode(unit, pdu, &mut [0; FRAME_BYTES_MAX]).unwrap().to_vec()
}

/// The CRC as the specification's text has it, bit by bit (Serial Line V1.02, clause 6.2.2).
pub(crate) fn naive_crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xA001 } else { crc >> 1 })
    })
}

#[test]
fn the_specifications_example_has_its_crc() {
    // Serial Line V1.02, clause 6.2.2: 02 07 is followed by 41 12.
    assert_eq!(frame(2, &[7]), [0x02, 0x07, 0x41, 0x12]);
    assert_eq!(decode(&[0x02, 0x07, 0x41, 0x12]), Ok((2, &[7][..])));
    // The check value of the algorithm's catalogue.
    assert_eq!(crc16(b"123456789"), 0x4B37);
}

#[test]
fn lengths_that_no_frame_has_are_refused_by_name() {
    let mut out = [0; FRAME_BYTES_MAX];
    assert_eq!(encode(1, &[], &mut out), Err(PduLength(0)));
    assert_eq!(encode(1, &[0; 254], &mut out), Err(PduLength(254)));
    assert_eq!(encode(1, &[0; 253], &mut out).map(<[u8]>::len), Ok(FRAME_BYTES_MAX));
    for short in 0..4 {
        assert_eq!(decode(&[0; 4][..short]), Err(RtuError::Short(short)));
    }
    assert_eq!(decode(&[0; 257]), Err(RtuError::Long(257)));
}

#[test]
fn whatever_the_units_and_however_long_the_frame_its_crc_is_changed_by_what_its_unit_changes() {
    for change in 1..=u8::MAX {
        let mut delta = CrcDelta::new(0, change);
        // Bit by bit, by the polynomial of Serial Line 2.5.1.2.
        let step = |register: u16| (0..8).fold(register, |crc, _| (crc >> 1) ^ ((crc & 1) * 0xa001));
        let mut expected = step(change.into());
        for length in 0..=253 {
            assert_eq!(u16::from_le_bytes(delta.translate([0; 2])), expected, "{change} {length}");
            delta.pass(1);
            expected = step(expected);
        }
    }
}

proptest! {
    #[test]
    fn a_frame_decodes_to_what_was_encoded(unit in any::<u8>(), pdu in any_pdu()) {
        let frame = frame(unit, &pdu);
        prop_assert_eq!(frame.len(), pdu.len() + 3);
        prop_assert_eq!(decode(&frame), Ok((unit, &pdu[..])));
    }

    #[test]
    fn the_table_agrees_with_the_bitwise_crc(bytes in vec(any::<u8>(), 0..=300)) {
        prop_assert_eq!(crc16(&bytes), naive_crc(&bytes));
    }

    #[test]
    fn corruption_of_up_to_16_neighbouring_bits_is_always_found(
        unit in any::<u8>(), pdu in any_pdu(), burst in 1u16.., place in any::<prop::sample::Index>(),
    ) {
        let good = frame(unit, &pdu);
        // Every single bit, and one burst.
        for bit in 0..good.len() * 8 {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            let found = matches!(decode(&bad), Err(RtuError::Crc { .. }));
            prop_assert!(found, "bit {} of {:02X?}", bit, good);
        }
        let mut bad = good.clone();
        let at = place.index(good.len() - 1);
        bad[at] ^= burst.to_le_bytes()[0];
        bad[at + 1] ^= burst.to_le_bytes()[1];
        let found = matches!(decode(&bad), Err(RtuError::Crc { .. }));
        prop_assert!(found);
    }

    #[test]
    fn random_bytes_decode_only_with_the_right_crc(bytes in vec(any::<u8>(), 0..=300)) {
        let good = matches!(&bytes[..], [body @ .., low, high]
            if (4..=256).contains(&bytes.len()) && naive_crc(body) == u16::from_le_bytes([*low, *high]));
        prop_assert_eq!(decode(&bytes).is_ok(), good);
    }

    #[test]
    fn another_units_id_turns_the_same_bits_of_the_crc_wrong_as_before(
        pdu in vec(any::<u8>(), 1..=253),
        from in any::<u8>(),
        to in any::<u8>(),
        corruption in any::<u16>(),
    ) {
        let crc = |unit| {
            let frame = frame(unit, &pdu);
            u16::from_le_bytes([frame[frame.len() - 2], frame[frame.len() - 1]])
        };
        let mut delta = CrcDelta::new(from, to);
        delta.pass(pdu.len());
        let sent = u16::from_le_bytes(delta.translate((crc(from) ^ corruption).to_le_bytes()));
        prop_assert_eq!(sent, crc(to) ^ corruption);
    }
}
