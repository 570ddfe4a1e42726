//! ASCII frames: encoding, the decoder character by character, the LRC.

use mobgate::modbus::ascii::{AsciiError, Decoder, FRAME_CHARS_MAX, LINE_FEED, encode};
use mobgate::modbus::crc::lrc;

use crate::prelude::*;
use crate::samples::any_pdu;

type Event = Result<(u8, Vec<u8>), AsciiError>;

fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    encode(unit, pdu, &mut [0; FRAME_CHARS_MAX], LINE_FEED).unwrap().to_vec()
}

/// What a decoder says of `characters`.
fn decode(decoder: &mut Decoder, characters: &[u8]) -> Vec<Event> {
    let mut events = Vec::new();
    for &character in characters {
        if let Some(event) = decoder.push(character) {
            events.push(event.map(|(unit, pdu)| (unit, pdu.to_vec())));
        }
    }
    events
}

/// What a new decoder says of `characters`.
fn decode_all(characters: &[u8]) -> Vec<Event> {
    decode(&mut Decoder::default(), characters)
}

#[test]
fn a_read_request_has_the_textbooks_characters() {
    assert_eq!(frame(0xF7, &[3, 0x13, 0x89, 0, 0x0A]), b":F7031389000A60\r\n");
    assert_eq!(decode_all(b":F7031389000A60\r\n"), [Ok((0xF7, vec![3, 0x13, 0x89, 0, 0x0A]))]);
    assert_eq!(lrc(&[0xF7, 3, 0x13, 0x89, 0, 0x0A]), 0x60);
}

#[test]
fn each_fault_has_its_name() {
    let first = |characters: &[u8]| decode_all(characters).into_iter().next();
    assert_eq!(first(b":F7031389000A61\r\n"), Some(Err(AsciiError::Lrc { received: 0x61, computed: 0x60 })));
    assert_eq!(first(b":F703138900a60\r\n"), Some(Err(AsciiError::NotHex(b'a'))));
    assert_eq!(first(b":F70313 \r\n"), Some(Err(AsciiError::NotHex(b' '))));
    assert_eq!(first(b":F7031\r\n"), Some(Err(AsciiError::Odd)));
    assert_eq!(first(b":F7031389000A60\r\r"), Some(Err(AsciiError::NoLf(b'\r'))));
    assert_eq!(first(b":\r\n"), Some(Err(AsciiError::Short(0))));
    assert_eq!(first(b":0000\r\n"), Some(Err(AsciiError::Short(2))));
    assert_eq!(first(&[&b":"[..], &[b'0'; 512]].concat()), Some(Err(AsciiError::Long)));
    assert_eq!(first(b"F7031389000A60\r\n"), None);
    assert_eq!(first(b":F7031389000A60\n"), Some(Err(AsciiError::NotHex(b'\n'))));
}

#[test]
fn what_follows_a_fault_is_skipped_up_to_the_next_colon() {
    assert_eq!(decode_all(b":01x07F8\r\n"), [Err(AsciiError::NotHex(b'x'))]);
    assert_eq!(decode_all(b":01\rx\n07F8\r\n"), [Err(AsciiError::NoLf(b'x'))]);
    assert_eq!(decode_all(b":01070\r\n:0107F8\r\n"), [Err(AsciiError::Odd), Ok((1, vec![7]))]);
}

#[test]
fn the_end_character_can_be_another() {
    let mut out = [0; FRAME_CHARS_MAX];
    let characters = encode(1, &[7], &mut out, b'!').unwrap();
    assert_eq!(characters, b":0107F8\r!");
    assert_eq!(decode(&mut Decoder::new(b'!'), characters), [Ok((1, vec![7]))]);
    assert_eq!(decode_all(characters), [Err(AsciiError::NoLf(b'!'))]);
}

#[test]
fn a_cleared_decoder_waits_for_the_next_colon() {
    let mut decoder = Decoder::default();
    assert!(!decoder.in_frame());
    assert_eq!(decode(&mut decoder, b":0107"), []);
    assert!(decoder.in_frame());
    decoder.clear();
    assert!(!decoder.in_frame());
    assert_eq!(decode(&mut decoder, b"F8\r\n"), []);
    assert_eq!(decode(&mut decoder, b":0107F8\r\n"), [Ok((1, vec![7]))]);
    assert!(!decoder.in_frame());
}

#[test]
fn pdus_that_no_frame_carries_are_refused() {
    let mut out = [0; FRAME_CHARS_MAX];
    assert_eq!(encode(1, &[], &mut out, LINE_FEED), Err(PduLength(0)));
    assert_eq!(encode(1, &[0; 254], &mut out, LINE_FEED), Err(PduLength(254)));
    assert_eq!(encode(1, &[0; 253], &mut out, LINE_FEED).map(<[u8]>::len), Ok(FRAME_CHARS_MAX));
}

/// The good frames of a stream, found at each of its ends: all between the last colon and the end.
fn naive_frames(stream: &[u8]) -> Vec<(u8, Vec<u8>)> {
    let mut frames = Vec::new();
    for end in (0..stream.len()).filter(|&end| stream[..=end].ends_with(b"\r\n")) {
        let Some(colon) = stream[..end].iter().rposition(|&character| character == b':') else { continue };
        let digits = String::from_utf8_lossy(&stream[colon + 1..end - 1]);
        let digit = |character: char| character.is_ascii_digit() || ('A'..='F').contains(&character);
        if !digits.chars().all(digit) || digits.len() % 2 == 1 || !(6..=510).contains(&digits.len()) {
            continue;
        }
        let byte = |at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap();
        let bytes: Vec<u8> = (0..digits.len()).step_by(2).map(byte).collect();
        if bytes.iter().map(|&byte| u32::from(byte)).sum::<u32>() % 256 == 0 {
            frames.push((bytes[0], bytes[1..bytes.len() - 1].to_vec()));
        }
    }
    frames
}

/// Streams of good frames, cut frames and characters that frames are made of.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    let good = (any::<u8>(), vec(any::<u8>(), 1..=6)).prop_map(|(unit, pdu)| frame(unit, &pdu));
    let cut = (good.clone(), any::<prop::sample::Index>())
        .prop_map(|(frame, end)| frame[..end.index(frame.len())].to_vec());
    let alphabet = prop::sample::select(&b":0123456789ABCDEFaf \r\n"[..]);
    let piece = prop_oneof![
        3 => good,
        2 => cut,
        1 => vec(alphabet, 0..=10),
        1 => vec(any::<u8>(), 0..=10),
        1 => vec(Just(b'0'), 500..=520),
    ];
    vec(piece, 0..=6).prop_map(|pieces| pieces.concat())
}

proptest! {
    #[test]
    fn a_frame_decodes_to_what_was_encoded(unit in any::<u8>(), pdu in any_pdu()) {
        let characters = frame(unit, &pdu);
        prop_assert_eq!(characters.len(), 2 * pdu.len() + 7);
        prop_assert_eq!(decode_all(&characters), [Ok((unit, pdu))]);
        for end in 0..characters.len() {
            prop_assert_eq!(decode_all(&characters[..end]), []);
        }
    }

    #[test]
    fn the_good_frames_of_any_stream_are_found(stream in stream()) {
        let found: Vec<_> = decode_all(&stream).into_iter().flatten().collect();
        prop_assert_eq!(found, naive_frames(&stream));
    }

    #[test]
    fn a_colon_begins_anew_wherever_it_comes(stream in stream(), unit in any::<u8>(), pdu in any_pdu()) {
        let last = decode_all(&[&stream[..], &frame(unit, &pdu)].concat()).pop();
        prop_assert_eq!(last, Some(Ok((unit, pdu))));
    }

    #[test]
    fn a_single_wrong_bit_is_always_found(unit in any::<u8>(), pdu in vec(any::<u8>(), 1..=40)) {
        let good = frame(unit, &pdu);
        for bit in 0..good.len() * 8 {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            // A digit that turns into a colon (32h to 3Ah) begins a frame, which has an LRC of its own.
            if bad[bit / 8] != b':' {
                let accepted = decode_all(&bad).iter().any(Result::is_ok);
                prop_assert!(!accepted, "bit {} of {:?}", bit, String::from_utf8_lossy(&good));
            }
        }
    }

    #[test]
    fn random_characters_never_panic(characters in vec(any::<u8>(), 0..=2000)) {
        let found: Vec<_> = decode_all(&characters).into_iter().flatten().collect();
        prop_assert_eq!(found, naive_frames(&characters));
    }
}
