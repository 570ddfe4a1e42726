//! ASCII: round trip, corruption, and frames among other characters.
#![no_main]

use libfuzzer_sys::arbitrary::{self, Arbitrary};
use libfuzzer_sys::fuzz_target;
use mobgate::modbus::ascii::{AsciiError, Decoder, FRAME_CHARS_MAX, LINE_FEED, encode};

#[derive(Debug, Arbitrary)]
struct Input<'a> {
    unit: u8,
    pdu: &'a [u8],
    /// A bit of the frame to turn over.
    bit: u16,
    before: &'a [u8],
}

type Event = Result<(u8, Vec<u8>), AsciiError>;

fuzz_target!(|input: Input| {
    let Input { unit, pdu, bit, before } = input;
    let mut decoder = Decoder::default();
    for (unit, pdu) in decode(&mut decoder, before).into_iter().flatten() {
        let mut out = [0; FRAME_CHARS_MAX];
        let frame = encode(unit, &pdu, &mut out, LINE_FEED).expect("what was decoded is a PDU");
        assert!(before.windows(frame.len()).any(|window| window == frame));
    }

    let mut out = [0; FRAME_CHARS_MAX];
    let Ok(frame) = encode(unit, pdu, &mut out, LINE_FEED) else {
        assert!(pdu.is_empty() || pdu.len() > 253);
        return;
    };
    // The colon ends whatever came before: of that, nothing remains.
    assert_eq!(decode(&mut decoder, frame), [Ok((unit, pdu.to_vec()))]);
    assert!(!decoder.in_frame());
    corruption(frame, bit);
});

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

/// No single wrong bit passes, but for one that makes a colon: what follows is a frame of its own.
fn corruption(frame: &[u8], bit: u16) {
    let mut corrupt = frame.to_vec();
    let bit = usize::from(bit) % (8 * corrupt.len());
    corrupt[bit / 8] ^= 1 << (bit % 8);
    if corrupt[bit / 8] != b':' {
        assert!(decode(&mut Decoder::default(), &corrupt).iter().all(Result::is_err));
    }
}
