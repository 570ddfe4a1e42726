//! What a frame is that was heard on a shared bus, by value.

use mobgate::modbus::rtu;
use mobgate::port::line::sniffer::{AsciiSniffer, RtuSniffer, Sniffed};
use mobgate_simulator::device::ascii;

use crate::prelude::*;

const OURS: u8 = 10;
const OTHER: u8 = 7;
/// FC 3, two registers from 0.
const READ: [u8; 5] = [3, 0, 0, 0, 2];
const RESPONSE: [u8; 6] = [3, 4, 1, 2, 3, 4];

fn is_ours(unit: u8) -> bool {
    unit == OURS
}

fn frame(unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut out = [0; 256];
    rtu::encode(unit, pdu, &mut out).unwrap().to_vec()
}

/// What is told without its bytes, so that it can be kept.
#[derive(Debug, PartialEq)]
enum Told {
    Request(u8, Vec<u8>),
    ForeignRequest,
    ForeignResponse,
    Garbage(LastError),
}

fn told(heard: Sniffed) -> Option<Told> {
    Some(match heard {
        Sniffed::Request { unit, pdu } => Told::Request(unit, pdu.to_vec()),
        Sniffed::ForeignRequest => Told::ForeignRequest,
        Sniffed::ForeignResponse => Told::ForeignResponse,
        Sniffed::Garbage(error) => Told::Garbage(error),
        Sniffed::Nothing => return None,
    })
}

/// An ear, and what it has not judged yet.
struct Listener {
    sniffer: RtuSniffer,
    received: Vec<u8>,
}

impl Listener {
    /// Switched on, and in step after a silence.
    fn in_step() -> Self {
        let mut listener = Self { sniffer: RtuSniffer::new(), received: Vec::new() };
        assert_eq!(listener.silence(), []);
        listener
    }

    /// Hears bytes with silence behind them.
    fn frame(&mut self, bytes: &[u8]) -> Vec<Told> {
        self.received.extend_from_slice(bytes);
        self.silence()
    }

    /// Hears bytes; whether there is silence behind them cannot be told.
    fn bytes(&mut self, bytes: &[u8]) -> Vec<Told> {
        self.received.extend_from_slice(bytes);
        self.judge(false)
    }

    fn silence(&mut self) -> Vec<Told> {
        self.judge(true)
    }

    fn judge(&mut self, silent: bool) -> Vec<Told> {
        let mut all = Vec::new();
        loop {
            let (heard, count) = self.sniffer.feed(&self.received, silent, is_ours);
            let told = told(heard);
            self.received.drain(..count);
            match told {
                Some(told) => all.push(told),
                None => return all,
            }
        }
    }
}

fn ours(pdu: &[u8]) -> Told {
    Told::Request(OURS, pdu.to_vec())
}

#[test]
fn requests_for_us_are_found_among_others_and_their_responses() {
    let mut listener = Listener::in_step();
    assert_eq!(listener.frame(&frame(OTHER, &READ)), [Told::ForeignRequest]);
    assert_eq!(listener.frame(&frame(OTHER, &RESPONSE)), [Told::ForeignResponse]);
    assert_eq!(listener.frame(&frame(OURS, &READ)), [ours(&READ)]);
    assert_eq!(listener.frame(&frame(OTHER, &READ)), [Told::ForeignRequest]);
    // The other one is silent, and the master goes on.
    assert_eq!(listener.frame(&frame(OURS, &READ)), [ours(&READ)]);
}

#[test]
fn a_foreign_frame_with_two_readings_is_a_response_after_its_request_and_a_request_otherwise() {
    let write = frame(OTHER, &[6, 0, 1, 0, 2]);
    let mut listener = Listener::in_step();
    assert_eq!(listener.frame(&write), [Told::ForeignRequest]);
    assert_eq!(listener.frame(&write), [Told::ForeignResponse]);
    assert_eq!(listener.frame(&write), [Told::ForeignRequest]);
    // Another unit's frame in between.
    assert_eq!(listener.frame(&frame(8, &[6, 0, 1, 0, 2])), [Told::ForeignRequest]);
    assert_eq!(listener.frame(&write), [Told::ForeignRequest]);
}

#[test]
fn functions_of_unknown_length_are_ended_by_silence() {
    let mut listener = Listener::in_step();
    assert_eq!(listener.bytes(&frame(OURS, &[65, 1, 2, 3])), []);
    assert_eq!(listener.silence(), [ours(&[65, 1, 2, 3])]);
}

#[test]
fn a_response_under_our_id_is_no_request() {
    let mut listener = Listener::in_step();
    assert_eq!(listener.frame(&frame(OURS, &RESPONSE)), [Told::Garbage(LastError::Length)]);
    assert_eq!(listener.frame(&frame(OURS, &[0x83, 2])), [Told::Garbage(LastError::Length)]);
    assert_eq!(listener.frame(&frame(OURS, &READ)), [ours(&READ)]);
}

#[test]
fn corrupt_frames_are_garbage_and_do_not_disturb_the_next() {
    let mut corrupt = frame(OURS, &READ);
    corrupt[3] ^= 1;
    let mut listener = Listener::in_step();
    assert_eq!(listener.frame(&corrupt), [Told::Garbage(LastError::Checksum)]);
    assert_eq!(listener.frame(&frame(OURS, &READ)[..3]), [Told::Garbage(LastError::Length)]);
    let long = [0x55; 300];
    assert_eq!(listener.frame(&long), [Told::Garbage(LastError::Length)]);
    // Noise right before a request spoils it.
    let noisy = [&[0xff], &frame(OURS, &READ)[..]].concat();
    assert_eq!(listener.frame(&noisy), [Told::Garbage(LastError::Checksum)]);
    assert_eq!(listener.frame(&frame(OURS, &READ)), [ours(&READ)]);
}

#[test]
fn who_is_switched_on_in_mid_traffic_waits_for_silence() {
    let traffic = [frame(OTHER, &RESPONSE), frame(OURS, &READ)].concat();
    for cut in 1..traffic.len() {
        let mut listener = Listener { sniffer: RtuSniffer::new(), received: Vec::new() };
        assert!(listener.sniffer.needs_silence());
        let told = listener.frame(&traffic[cut..]);
        let request = cut == traffic.len() - 8;
        // A frame that begins where the listening began is believed to be one, but is not answered.
        assert!(!told.contains(&ours(&READ)), "{cut}: {told:?}");
        assert_eq!(told == [Told::ForeignResponse], request, "{cut}: {told:?}");
        assert_eq!(listener.frame(&frame(OURS, &READ)), [ours(&READ)]);
    }
}

#[test]
fn without_silences_frames_are_parted_by_both_readings() {
    let traffic = [
        (frame(OTHER, &READ), Told::ForeignRequest),
        (frame(OTHER, &RESPONSE), Told::ForeignResponse),
        (frame(OURS, &READ), ours(&READ)),
        (frame(OTHER, &[16, 0, 0, 0, 1, 2, 9, 9]), Told::ForeignRequest),
        (frame(OTHER, &[16, 0, 0, 0, 1]), Told::ForeignResponse),
        (frame(8, &[3, 0, 0, 0, 100]), Told::ForeignRequest),
        (frame(8, &[0x83, 6]), Told::ForeignResponse),
        (frame(8, &[3, 0, 0, 0, 100]), Told::ForeignRequest),
        (frame(OURS, &[5, 0, 1, 0xff, 0]), ours(&[5, 0, 1, 0xff, 0])),
    ];
    let (bytes, expected): (Vec<_>, Vec<_>) = traffic.into_iter().unzip();
    let bytes = bytes.concat();
    for size in [1, 3, 8, bytes.len()] {
        let mut listener = Listener::in_step();
        let told: Vec<Told> = bytes.chunks(size).flat_map(|chunk| listener.bytes(chunk)).collect();
        assert_eq!(told, expected, "in pieces of {size}");
    }
}

#[test]
fn data_that_looks_like_a_request_is_not_one() {
    // The other one's registers hold a whole request for us.
    let inside = frame(OURS, &READ);
    let response = frame(OTHER, &[&[3, 8], &inside[..]].concat());
    let request = frame(OTHER, &[3, 0, 0, 0, 4]);
    for size in [1, 5, 200] {
        let mut listener = Listener::in_step();
        let bytes = [&request[..], &response].concat();
        let told: Vec<Told> = bytes.chunks(size).flat_map(|chunk| listener.bytes(chunk)).collect();
        assert_eq!(told, [Told::ForeignRequest, Told::ForeignResponse], "in pieces of {size}");
    }
    let mut listener = Listener::in_step();
    assert_eq!(listener.frame(&response), [Told::ForeignResponse]);
    assert_eq!(listener.frame(&request), [Told::ForeignRequest]);
    assert_eq!(listener.frame(&response), [Told::ForeignResponse]);
}

#[test]
fn who_has_lost_the_thread_finds_it_again_without_silence() {
    let mut listener = Listener::in_step();
    let noise: Vec<u8> = (0..300_u16).map(|number| (number * 37) as u8).collect();
    let exchange = [frame(OTHER, &READ), frame(OTHER, &RESPONSE), frame(OURS, &READ)].concat();
    let mut told = listener.bytes(&noise);
    for _ in 0..20 {
        told.extend(listener.bytes(&exchange));
    }
    let found = told.iter().filter(|told| **told == ours(&READ)).count();
    // As long as a frame can be, the noise could have been one; after that every request is found.
    assert!(found >= 5, "{found}");
    assert!(listener.received.len() < 256);
}

#[test]
fn an_ascii_line_needs_no_silence() {
    let mut sniffer = AsciiSniffer::new();
    let mut hear = |bytes: &[u8]| {
        let mut all = Vec::new();
        let mut bytes = bytes;
        loop {
            let (heard, count) = sniffer.feed(bytes, is_ours);
            let told = told(heard);
            bytes = &bytes[count..];
            match told {
                Some(told) => all.push(told),
                None => return all,
            }
        }
    };
    let traffic =
        [ascii::frame(OTHER, &READ), ascii::frame(OTHER, &RESPONSE), ascii::frame(OURS, &READ)].concat();
    assert_eq!(hear(&traffic), [Told::ForeignRequest, Told::ForeignResponse, ours(&READ)]);
    let lower = ascii::frame(OURS, &[3, 0, 0xab, 0, 1]).to_ascii_lowercase();
    assert_eq!(hear(&lower), [Told::Garbage(LastError::Ascii)]);
    let mut corrupt = ascii::frame(OURS, &READ);
    corrupt[4] = b'7';
    assert_eq!(hear(&corrupt), [Told::Garbage(LastError::Checksum)]);
    assert_eq!(hear(b":0A\r\n"), [Told::Garbage(LastError::Length)]);
    assert_eq!(hear(&ascii::frame(OURS, &RESPONSE)), [Told::Garbage(LastError::Length)]);
    assert_eq!(hear(&ascii::frame(OURS, &READ)), [ours(&READ)]);
}

#[test]
fn the_character_that_ends_ascii_frames_can_be_another() {
    let mut sniffer = AsciiSniffer::new();
    sniffer.set_delimiter(b'!');
    let mut frame = ascii::frame(OURS, &READ);
    assert_eq!(told(sniffer.feed(&frame, is_ours).0), Some(Told::Garbage(LastError::Ascii)));
    *frame.last_mut().unwrap() = b'!';
    assert_eq!(told(sniffer.feed(&frame, is_ours).0), Some(ours(&READ)));
    assert_eq!(sniffer.delimiter(), b'!');
}

#[test]
fn stray_bits_behind_a_request_do_not_spoil_it() {
    let mut listener = Listener::in_step();
    let told = listener.frame(&[&frame(OURS, &READ)[..], &[0]].concat());
    assert_eq!(told, [ours(&READ), Told::Garbage(LastError::Length)]);
}

#[test]
fn the_ear_knows_what_a_frame_has_at_least_by_each_of_its_readings() {
    let ours = |unit| unit == 10;
    let mut sniffer = RtuSniffer::new();
    assert_eq!(sniffer.at_least(&[10, 3], ours), None, "nothing is known before the first silence");
    let _ = sniffer.feed(&[], true, ours);
    assert_eq!(sniffer.at_least(&[], ours), None);
    assert_eq!(sniffer.at_least(&[10], ours), Some(4), "the shortest frame there is");
    assert_eq!(sniffer.at_least(&[10, 3], ours), Some(8));
    assert_eq!(sniffer.at_least(&[10, 16, 0, 0, 0, 2], ours), None, "its byte count will tell");
    assert_eq!(sniffer.at_least(&[10, 16, 0, 0, 0, 2, 4], ours), Some(13));
    assert_eq!(sniffer.at_least(&[10, 65, 0, 0], ours), None, "only the silence ends it");
    // Another unit's may be a request, or a response.
    assert_eq!(sniffer.at_least(&[1, 3, 2], ours), Some(7));
    assert_eq!(sniffer.at_least(&[1, 3, 20], ours), Some(8));
    let response = sniffer.at_least(&[1, 3, 20, 0, 0, 0, 0, 0], ours);
    assert_eq!(response, Some(25), "no request, or it would be judged");
    assert_eq!(sniffer.at_least(&[1, 65, 0, 0], ours), None);
}
