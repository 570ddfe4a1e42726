//! RTU: round trip, corruption, and the client's search for the response in a line's bytes.
#![no_main]

use libfuzzer_sys::arbitrary::{self, Arbitrary};
use libfuzzer_sys::fuzz_target;
use mobgate::modbus::pdu::{ResponseLength, check_request, fits, response_length};
use mobgate::modbus::rtu::{
    AtSilence, FRAME_BYTES_MAX, Received, decode, encode, response, response_at_silence,
};

#[derive(Debug, Arbitrary)]
struct Input<'a> {
    unit: u8,
    request: &'a [u8],
    pdu: &'a [u8],
    /// A bit of the frame to turn over.
    bit: u16,
    before: &'a [u8],
    behind: &'a [u8],
}

/// The search looks at every prefix of the line, so its cost grows with the square of this.
const LINE_BYTES_MAX: usize = 600;

fuzz_target!(|input: Input| {
    let Input { unit, request, pdu, bit, before, behind } = input;
    let _ = check_request(request);
    if let Ok((unit, pdu)) = decode(before) {
        assert_eq!(encode(unit, pdu, &mut [0; FRAME_BYTES_MAX]), Ok(before));
    }

    let mut out = [0; FRAME_BYTES_MAX];
    let Ok(frame) = encode(unit, pdu, &mut out) else {
        assert!(pdu.is_empty() || pdu.len() > 253);
        return;
    };
    assert_eq!(decode(frame), Ok((unit, pdu)));
    corruption(frame, bit);
    if fits(request, pdu).is_ok() {
        alone(unit, request, pdu, frame);
    }
    let line = [before, frame, behind].concat();
    if line.len() <= LINE_BYTES_MAX {
        search(unit, request, &line);
    }
});

/// No single wrong bit passes.
fn corruption(frame: &[u8], bit: u16) {
    let mut corrupt = frame.to_vec();
    let bit = usize::from(bit) % (8 * corrupt.len());
    corrupt[bit / 8] ^= 1 << (bit % 8);
    assert!(decode(&corrupt).is_err());
}

/// The response by itself is found with its last byte or at silence.
fn alone(unit: u8, request: &[u8], pdu: &[u8], frame: &[u8]) {
    assert_eq!(response_at_silence(unit, request, frame), AtSilence::Complete(pdu));
    // Only the masked code of a request that is none differs from its own exception's.
    if check_request(request).is_ok() {
        let by_silence = response_length(request, pdu) == ResponseLength::Silence;
        let expected = if by_silence { Received::Partial } else { Received::Complete(pdu) };
        assert_eq!(response(unit, request, frame), expected);
    }
}

/// What is found is a good frame and the response, and stays found when more bytes come.
fn search(unit: u8, request: &[u8], line: &[u8]) {
    let genuine = |pdu: &[u8]| {
        let mut out = [0; FRAME_BYTES_MAX];
        let frame = encode(unit, pdu, &mut out).expect("a response is a PDU");
        assert_eq!(fits(request, pdu), Ok(()));
        assert!(line.windows(frame.len()).any(|window| window == frame));
    };
    let mut found = None;
    for end in 0..=line.len() {
        match (found, response(unit, request, &line[..end])) {
            (None, Received::Partial) => {}
            (None, Received::Complete(pdu)) => {
                genuine(pdu);
                found = Some(pdu);
            }
            (Some(before), now) => assert_eq!(now, Received::Complete(before)),
        }
    }
    match (response_at_silence(unit, request, line), decode(line)) {
        (AtSilence::Complete(pdu), _) => genuine(pdu),
        (AtSilence::WrongUnit(from, pdu), whole) => assert_eq!(whole, Ok((from, pdu))),
        (AtSilence::Misfit(_, pdu), whole) => assert_eq!(whole, Ok((unit, pdu))),
        (AtSilence::Corrupt | AtSilence::Short | AtSilence::Noise, whole) => {
            assert!(whole.is_err());
            assert_eq!(found, None);
        }
    }
}
