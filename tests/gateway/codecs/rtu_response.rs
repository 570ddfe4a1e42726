//! The RTU client's search for the response: alone, among noise, cut anywhere, and against a naive model.

use mobgate::modbus::rtu::{self, AtSilence, Received, decode, response_at_silence};

use crate::prelude::*;
use crate::rtu::{frame, naive_crc};
use crate::samples::{any_pdu, exchange};

const READ: [u8; 5] = [3, 0, 0x6B, 0, 3];
const RESPONSE: [u8; 8] = [3, 6, 0x02, 0x2B, 0, 0, 0, 0x64];

#[test]
fn an_exception_ends_the_wait_with_its_fifth_byte() {
    let received = frame(17, &[0x83, 2]);
    assert_eq!(received.len(), 5);
    assert_eq!(rtu::response(17, &READ, &received[..4]), Received::Partial);
    assert_eq!(rtu::response(17, &READ, &received), Received::Complete(&[0x83, 2]));
}

#[test]
fn a_late_response_in_front_of_the_right_one_is_passed_over() {
    let other = [3, 2, 0xAA, 0xBB];
    let late = frame(17, &other);
    let received = [&late[..], &frame(17, &RESPONSE)].concat();
    assert_eq!(response_at_silence(17, &READ, &late), AtSilence::Misfit(Misfit::Length, &other));
    assert_eq!(rtu::response(17, &READ, &received[..late.len()]), Received::Partial);
    assert_eq!(rtu::response(17, &READ, &received), Received::Complete(&RESPONSE));
}

#[test]
fn a_frame_inside_of_a_responses_data_is_not_taken_for_the_response() {
    // The registers hold what looks like an exception of the same unit: 11 83 02 and its CRC.
    let inner = frame(0x11, &[0x83, 2]);
    let response = [&[3, 6][..], &inner, &[0]].concat();
    let received = frame(0x11, &response);
    assert_eq!(rtu::response(0x11, &READ, &received[..3 + inner.len()]), Received::Partial);
    assert_eq!(rtu::response(0x11, &READ, &received), Received::Complete(&response));
}

#[test]
fn an_unknown_functions_response_ends_with_the_silence_only() {
    let request = [0x41, 1];
    // The first four bytes of the response are a good frame by themselves.
    let short = frame(9, &[0x41]);
    let pdu = [&short[1..], &[7, 7, 7]].concat();
    let received = frame(9, &pdu);
    for end in 0..=received.len() {
        assert_eq!(rtu::response(9, &request, &received[..end]), Received::Partial);
    }
    assert_eq!(response_at_silence(9, &request, &received), AtSilence::Complete(&pdu));
    assert_eq!(rtu::response(9, &request, &frame(9, &[0xC1, 1])), Received::Complete(&[0xC1, 1]));
}

#[test]
fn silence_tells_foreign_corrupt_and_meaningless_bytes_apart() {
    let mut corrupt = frame(17, &RESPONSE);
    corrupt[5] ^= 0x10;
    assert_eq!(response_at_silence(17, &READ, &corrupt), AtSilence::Corrupt);
    assert_eq!(response_at_silence(17, &READ, &frame(17, &RESPONSE)[..6]), AtSilence::Short);
    assert_eq!(response_at_silence(17, &READ, &[17, 0x83]), AtSilence::Short);
    assert_eq!(response_at_silence(17, &READ, &frame(18, &RESPONSE)), AtSilence::WrongUnit(18, &RESPONSE));
    let misfit = AtSilence::Misfit(Misfit::Function, &[4, 2, 0, 0]);
    assert_eq!(response_at_silence(17, &READ, &frame(17, &[4, 2, 0, 0])), misfit);
    for noise in [&[][..], &[17], &[0, 0xFF], &[18, 3, 6], &[0; 300]] {
        assert_eq!(response_at_silence(17, &READ, noise), AtSilence::Noise);
    }
}

#[test]
fn a_good_frame_that_repeats_another_address_is_no_response() {
    let (request, other) = ([6, 0, 1, 0, 3], [6, 0, 2, 0, 3]);
    let received = frame(17, &other);
    assert_eq!(rtu::response(17, &request, &received), Received::Partial);
    assert_eq!(response_at_silence(17, &request, &received), AtSilence::Misfit(Misfit::Echo, &other));
    let received = [&[0xFF][..], &received].concat();
    assert_eq!(response_at_silence(17, &request, &received), AtSilence::Noise);
}

#[test]
fn a_beginning_that_would_be_longer_than_frames_are_is_passed_over() {
    let response = [17, 1, 0x2A];
    let received = [&[9, 17, 255][..], &frame(9, &response)].concat();
    assert_eq!(rtu::response(9, &[17], &received), Received::Complete(&response));
    // Nobody knows where function 41h ends, but after 256 bytes it did not begin here.
    let received = [&[9, 0x41][..], &[0; 249], &frame(9, &[0xC1, 1])].concat();
    assert_eq!(rtu::response(9, &[0x41], &received), Received::Partial);
    let received = [&[9, 0x41][..], &[0; 250], &frame(9, &[0xC1, 1])].concat();
    assert_eq!(rtu::response(9, &[0x41], &received), Received::Complete(&[0xC1, 1]));
}

/// Every frame in `received` that is a response, by trying all places: the start, and the PDU.
///
/// A function's response whose end only the silence tells must reach to the end.
fn naive_responses(unit: u8, request: &[u8], received: &[u8]) -> Vec<(usize, Vec<u8>)> {
    let mut responses = Vec::new();
    for start in 0..received.len() {
        for end in start + 4..=received.len().min(start + 256) {
            let pdu = &received[start + 1..end - 2];
            let crc = u16::from_le_bytes([received[end - 2], received[end - 1]]);
            let ends = response_length(request, pdu) != ResponseLength::Silence || end == received.len();
            let ours = received[start] == unit && fits(request, pdu).is_ok();
            if ours && ends && naive_crc(&received[start..end - 2]) == crc {
                responses.push((start, pdu.to_vec()));
            }
        }
    }
    responses
}

/// A unit, a request, its response, and a line's bytes: pieces of frames, good and bad, and noise that resembles them.
fn lines() -> impl Strategy<Value = (u8, Vec<u8>, Vec<u8>, Vec<u8>)> {
    (any::<u8>(), exchange()).prop_flat_map(|(unit, (request, response))| {
        let function = request[0];
        let good = frame(unit, &response);
        let resembling = prop_oneof![Just(unit), Just(function), Just(function | 0x80), any::<u8>()];
        let cut = good.clone();
        let corrupt = good.clone();
        let piece = prop_oneof![
            3 => Just(good),
            2 => vec(resembling, 0..=12),
            1 => any::<prop::sample::Index>().prop_map(move |end| cut[..end.index(cut.len())].to_vec()),
            1 => (any::<prop::sample::Index>(), 1u8..).prop_map(move |(at, bits)| {
                let mut corrupt = corrupt.clone();
                let at = at.index(corrupt.len());
                corrupt[at] ^= bits;
                corrupt
            }),
            1 => (any::<u8>(), vec(any::<u8>(), 1..=20)).prop_map(|(unit, pdu)| frame(unit, &pdu)),
            1 => vec(any::<u8>(), 1..=20).prop_map(move |pdu| frame(unit, &pdu)),
        ];
        (Just(unit), Just(request), Just(response), vec(piece, 0..=4).prop_map(|pieces| pieces.concat()))
    })
}

proptest! {
    #[test]
    fn a_response_is_complete_with_its_last_byte_and_not_before(unit in any::<u8>(), (request, response) in exchange()) {
        let received = frame(unit, &response);
        for end in 0..received.len() {
            prop_assert_eq!(rtu::response(unit, &request, &received[..end]), Received::Partial);
        }
        let by_silence = response_length(&request, &response) == ResponseLength::Silence;
        let early = if by_silence { Received::Partial } else { Received::Complete(&response[..]) };
        prop_assert_eq!(rtu::response(unit, &request, &received), early);
        prop_assert_eq!(response_at_silence(unit, &request, &received), AtSilence::Complete(&response));
    }

    #[test]
    fn noise_in_front_does_not_hide_a_response(
        unit in any::<u8>(), (request, response) in exchange(), noise in vec(any::<u8>(), 1..=20),
    ) {
        // Noise that holds the response's two first bytes may well delay it until the silence.
        let received = [&noise[..], &frame(unit, &response)].concat();
        let header = |pair: &[u8]| pair[0] == unit && pair[1] & 0x7F == request[0];
        prop_assume!(!received[..noise.len() + 1].windows(2).any(header));
        let early = rtu::response(unit, &request, &received);
        match response_length(&request, &response) {
            ResponseLength::Silence => prop_assert_eq!(early, Received::Partial),
            _ => prop_assert_eq!(early, Received::Complete(&response[..])),
        }
        // By chance of the CRC, the noise can make another frame of the whole.
        if decode(&received).is_err() {
            prop_assert_eq!(response_at_silence(unit, &request, &received), AtSilence::Complete(&response));
        }
    }

    #[test]
    fn how_reads_cut_the_stream_makes_no_difference((unit, request, _, line) in lines()) {
        let mut found = None;
        for end in 0..=line.len() {
            match (rtu::response(unit, &request, &line[..end]), found) {
                (Received::Complete(pdu), None) => found = Some(pdu),
                (now, None) => prop_assert_eq!(now, Received::Partial),
                (now, Some(pdu)) => prop_assert_eq!(now, Received::Complete(pdu)),
            }
        }
    }

    #[test]
    fn what_is_found_is_what_a_naive_search_finds((unit, request, _, line) in lines()) {
        let responses = naive_responses(unit, &request, &line);
        if let Received::Complete(pdu) = rtu::response(unit, &request, &line) {
            prop_assert!(responses.iter().any(|(_, response)| response == pdu));
        }
        let at_silence = response_at_silence(unit, &request, &line);
        match (decode(&line), at_silence) {
            // A frame that takes the whole line is judged as such.
            (Ok((from, whole)), AtSilence::WrongUnit(unit, pdu)) => prop_assert_eq!((from, whole), (unit, pdu)),
            (Ok((from, whole)), AtSilence::Misfit(misfit, pdu)) => {
                prop_assert_eq!(whole, pdu);
                prop_assert_eq!(from, unit);
                prop_assert_eq!(fits(&request, whole), Err(misfit));
            }
            (Ok((from, whole)), AtSilence::Complete(pdu)) => {
                prop_assert_eq!(from, unit);
                prop_assert_eq!(whole, pdu);
                prop_assert_eq!(fits(&request, pdu), Ok(()));
            }
            (Err(_), AtSilence::Complete(pdu)) => {
                prop_assert_eq!(Some(pdu), responses.first().map(|(_, response)| &response[..]));
            }
            (Err(_), AtSilence::Corrupt | AtSilence::Short) => {
                prop_assert!(responses.is_empty());
                prop_assert!(line[0] == unit && line[1] & 0x7F == request[0]);
            }
            (Err(_), AtSilence::Noise) => {
                prop_assert!(responses.is_empty());
                prop_assert!(line.len() < 2 || line[0] != unit || line[1] & 0x7F != request[0]);
            }
            unexpected => prop_assert!(false, "{:?}", unexpected),
        }
    }

    #[test]
    fn random_bytes_never_panic_and_never_respond(unit in any::<u8>(), request in any_pdu(), line in vec(any::<u8>(), 0..=600)) {
        let naive = naive_responses(unit, &request, &line);
        if let Received::Complete(pdu) = rtu::response(unit, &request, &line) {
            prop_assert!(naive.iter().any(|(_, response)| response == pdu));
        }
        let _ = response_at_silence(unit, &request, &line);
    }
}
