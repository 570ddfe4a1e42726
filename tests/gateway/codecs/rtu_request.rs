//! Requests cut out of an RTU stream.

use mobgate::modbus::pdu::{End, request_end, request_length};
use mobgate::modbus::rtu::{self, Cut, FRAME_BYTES_MAX, encode};

use super::samples::EXAMPLES;
use crate::prelude::*;

fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    encode(unit, pdu, &mut [0; FRAME_BYTES_MAX]).unwrap().to_vec()
}

/// What a server gets when `pieces` come one after the other, and then a pause.
fn cut(pieces: &[Vec<u8>]) -> Vec<(u8, Vec<u8>)> {
    let mut requests = Vec::new();
    let mut buffer: Vec<u8> = Vec::new();
    for piece in pieces {
        for byte in piece {
            buffer.push(*byte);
            assert!(buffer.len() <= FRAME_BYTES_MAX + 1, "the buffer of a server is bounded");
            while take(&mut buffer, &mut requests, rtu::request) {}
        }
    }
    while take(&mut buffer, &mut requests, rtu::request_at_pause) {}
    requests
}

fn take(
    buffer: &mut Vec<u8>,
    requests: &mut Vec<(u8, Vec<u8>)>,
    look: impl for<'a> Fn(&'a [u8]) -> Cut<'a>,
) -> bool {
    let consumed = match look(buffer) {
        Cut::Incomplete => return false,
        Cut::Noise { consumed } => consumed,
        Cut::Request { unit, pdu, consumed } => {
            requests.push((unit, pdu.to_vec()));
            consumed
        }
    };
    buffer.drain(..consumed);
    consumed > 0
}

#[test]
fn the_longest_request_that_a_frame_holds_is_cut_out_and_a_longer_one_is_none() {
    // Function 21 counts its bytes: of the PDU two less.
    let mut pdu = vec![0x5a; 253];
    pdu[..2].copy_from_slice(&[21, 251]);
    assert_eq!(request_end(&[21, 251]), End::At(253));
    assert_eq!(request_end(&[21, 252]), End::Unknown);
    let longest = frame(17, &pdu);
    assert_eq!(rtu::request(&longest), Cut::Request { unit: 17, pdu: &pdu, consumed: FRAME_BYTES_MAX });
    assert_eq!(rtu::request(&longest[..FRAME_BYTES_MAX - 1]), Cut::Incomplete);
    assert_ne!(rtu::request(&[&[17, 21, 252][..], &[0; 253]].concat()), Cut::Incomplete);
}

#[test]
fn the_specifications_examples_are_cut_out_and_their_length_is_known() {
    for (request, _) in EXAMPLES {
        // The sub-function that returns the query takes any number of bytes.
        if request[..] != *b"\x08\x00\x00\xA5\x37" {
            assert_eq!(request_length(request), Some(request.len()), "{request:02x?}");
            let expected = Cut::Request { unit: 17, pdu: request, consumed: request.len() + 3 };
            assert_eq!(rtu::request(&frame(17, request)), expected);
        }
        assert_eq!(cut(&[frame(17, request)]), [(17, request.to_vec())]);
    }
}

#[test]
fn noise_that_is_by_chance_a_frame_of_unknown_length_does_not_swallow_the_request_behind_it() {
    let request = frame(17, &[3, 0, 0, 0, 1]);
    // With them in front the CRC behind the request is right as well.
    let noise = (0..=u16::MAX).map(|number| number.to_be_bytes()).map(|[a, b]| [9, 65, a, b]);
    let noise =
        noise.into_iter().find(|noise| rtu::decode(&[&noise[..], &request].concat()).is_ok()).unwrap();
    assert_eq!(cut(&[[&noise[..], &request].concat()]), [(17, vec![3, 0, 0, 0, 1])]);
}

#[test]
fn a_longer_buffer_than_a_frame_is_never_incomplete() {
    for byte in 0..=255 {
        for length in FRAME_BYTES_MAX + 1..FRAME_BYTES_MAX + 5 {
            assert_ne!(rtu::request(&vec![byte; length]), Cut::Incomplete, "{byte}");
        }
    }
}

#[test]
fn the_longest_frame_of_unknown_length_waits_for_its_pause() {
    let pdu: Vec<u8> = [&[65][..], &[0; 252]].concat();
    let longest = frame(17, &pdu);
    assert_eq!(longest.len(), FRAME_BYTES_MAX);
    assert_eq!(rtu::request(&longest), Cut::Incomplete);
    let whole = Cut::Request { unit: 17, pdu: &pdu, consumed: FRAME_BYTES_MAX };
    assert_eq!(rtu::request_at_pause(&longest), whole);
}

fn known() -> impl Strategy<Value = Vec<u8>> {
    let examples: Vec<&[u8]> = EXAMPLES.iter().map(|(request, _)| *request).collect();
    let known = prop::sample::select(examples).prop_map(<[u8]>::to_vec);
    known.prop_filter("a length that the function tells", |pdu| request_length(pdu) == Some(pdu.len()))
}

proptest! {
    #[test]
    fn requests_in_a_row_are_all_cut_out_in_order(requests in vec((any::<u8>(), known()), 1..10)) {
        let stream: Vec<u8> = requests.iter().flat_map(|(unit, pdu)| frame(*unit, pdu)).collect();
        prop_assert_eq!(cut(&[stream]), requests);
    }

    /// Some of the garbage may have a right CRC, by chance, and take the request's beginning with it.
    #[test]
    fn a_request_is_found_behind_garbage_by_the_pause_at_the_latest(
        garbage in vec(any::<u8>(), 0..600),
        unit in any::<u8>(),
        pdu in known(),
    ) {
        let found = cut(&[garbage, frame(unit, &pdu)]);
        let by_chance = found.iter().any(|request| *request != (unit, pdu.clone()));
        prop_assert!(by_chance || found == [(unit, pdu)], "{:02x?}", found);
    }

    #[test]
    fn a_corrupt_request_is_none(pdu in known(), unit in any::<u8>(), place in any::<prop::sample::Index>(), bit in 0..8) {
        let mut bytes = frame(unit, &pdu);
        bytes[place.index(pdu.len() + 3)] ^= 1_u8 << bit;
        // A turned bit may make it another function, whose shorter request is followed by something.
        prop_assert!(!cut(&[bytes]).contains(&(unit, pdu)));
    }

    #[test]
    fn arbitrary_bytes_never_panic_and_never_stop_the_cutting(pieces in vec(vec(any::<u8>(), 0..300), 0..5)) {
        cut(&pieces);
    }
}
