//! Modbus TCP frames: the header, and frames cut out of a stream.

use mobgate::modbus::tcp::{ADU_BYTES_MAX, Header, MbapError, Parsed, encode, parse};

use crate::prelude::*;
use crate::samples::{any_pdu, cut};

fn frame(header: Header, pdu: &[u8]) -> Vec<u8> {
    encode(header, pdu, &mut [0; ADU_BYTES_MAX]).unwrap().to_vec()
}

fn header() -> impl Strategy<Value = Header> {
    (any::<u16>(), any::<u8>()).prop_map(|(transaction, unit)| Header { transaction, unit })
}

#[test]
fn the_guides_example_has_its_bytes() {
    // Messaging on TCP/IP V1.0b, clause 4.4.1.2: read register 5.
    let bytes = [0x15, 0x01, 0, 0, 0, 6, 0xFF, 3, 0, 4, 0, 1];
    let header = Header { transaction: 0x1501, unit: 0xFF };
    assert_eq!(frame(header, &[3, 0, 4, 0, 1]), bytes);
    assert_eq!(parse(&bytes), Ok(Parsed::Frame { header, pdu: &bytes[7..], consumed: 12 }));
}

#[test]
fn a_length_that_no_frame_has_is_seen_with_its_last_byte() {
    for length in 0..=u16::MAX {
        for protocol in [0, 1] {
            let [high, low] = length.to_be_bytes();
            let bytes = [0, 1, 0, protocol, high, low];
            let good = (2..=254).contains(&length);
            let expected = if good { Ok(Parsed::Incomplete) } else { Err(MbapError::Length(length)) };
            assert_eq!(parse(&bytes), expected);
            assert_eq!(parse(&bytes[..5]), Ok(Parsed::Incomplete));
        }
    }
}

#[test]
fn pdus_that_no_frame_carries_are_refused() {
    let header = Header { transaction: 0, unit: 0 };
    let mut out = [0; ADU_BYTES_MAX];
    assert_eq!(encode(header, &[], &mut out), Err(PduLength(0)));
    assert_eq!(encode(header, &[0; 254], &mut out), Err(PduLength(254)));
    assert_eq!(encode(header, &[0; 253], &mut out).map(<[u8]>::len), Ok(ADU_BYTES_MAX));
}

proptest! {
    #[test]
    fn a_frame_parses_to_what_was_encoded(header in header(), pdu in any_pdu(), behind in vec(any::<u8>(), 0..=20)) {
        let bytes = frame(header, &pdu);
        let consumed = pdu.len() + 7;
        prop_assert_eq!(bytes.len(), consumed);
        for end in 0..consumed {
            prop_assert_eq!(parse(&bytes[..end]), Ok(Parsed::Incomplete));
        }
        let bytes = [&bytes[..], &behind].concat();
        prop_assert_eq!(parse(&bytes), Ok(Parsed::Frame { header, pdu: &pdu, consumed }));
    }

    #[test]
    fn a_stream_cut_anywhere_gives_its_frames_in_order(
        frames in vec((header(), any_pdu(), prop_oneof![3 => Just(0u16), 1 => any::<u16>()]), 0..=6),
        places in vec(any::<prop::sample::Index>(), 0..=30),
    ) {
        let mut stream = Vec::new();
        for (header, pdu, protocol) in &frames {
            let mut bytes = frame(*header, pdu);
            bytes[2..4].copy_from_slice(&protocol.to_be_bytes());
            stream.extend(bytes);
        }
        let mut buffer: Vec<u8> = Vec::new();
        let mut found = Vec::new();
        for piece in cut(&stream, &places) {
            buffer.extend(piece);
            loop {
                let used = match parse(&buffer).unwrap() {
                    Parsed::Incomplete => break,
                    Parsed::Skip { consumed } => consumed,
                    Parsed::Frame { header, pdu, consumed } => {
                        found.push((header, pdu.to_vec()));
                        consumed
                    }
                };
                buffer.drain(..used);
            }
            prop_assert!(buffer.len() < ADU_BYTES_MAX);
        }
        prop_assert!(buffer.is_empty());
        let expected: Vec<_> = frames.into_iter().filter(|frame| frame.2 == 0).map(|(h, p, _)| (h, p)).collect();
        prop_assert_eq!(found, expected);
    }

    #[test]
    fn a_full_buffer_is_never_incomplete(bytes in vec(any::<u8>(), ADU_BYTES_MAX), length in 0u16..=300) {
        let mut bytes = bytes;
        bytes[4..6].copy_from_slice(&length.to_be_bytes());
        prop_assert_ne!(parse(&bytes), Ok(Parsed::Incomplete));
    }

    #[test]
    fn what_is_found_stays_when_more_bytes_come(bytes in vec(any::<u8>(), 0..=600), length in 0u16..=300) {
        let mut bytes = bytes;
        if let Some(field) = bytes.get_mut(4..6) {
            field.copy_from_slice(&length.to_be_bytes());
        }
        let mut found = None;
        for end in 0..=bytes.len() {
            let now = parse(&bytes[..end]);
            match found {
                None if now == Ok(Parsed::Incomplete) => {}
                None => found = Some(now),
                Some(before) => prop_assert_eq!(now, before),
            }
        }
    }
}
