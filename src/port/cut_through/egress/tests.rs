//! What of a frame is sent, and when: characters by value.

// The locks of a host.
use mobgate_clock as _;

extern crate std;
use std::vec::Vec;

use super::{Form, Sent, digits, rtu};
use crate::frame::{Frame, FramePool, FrameWriter, Slot};
use crate::modbus::ascii::LINE_FEED;
use crate::port::line::framing::FRAME_CHARS_MAX;
use crate::settings::Framing;

const UNITS: [(u8, u8); 2] = [(5, 5), (105, 5)];
const READ: [u8; 5] = [3, 0, 7, 0, 1];
const LONG: [u8; 40] = [0x5a; 40];

/// The frame of `unit` and `pdu`.
fn encoded(framing: Framing, unit: u8, pdu: &[u8]) -> Vec<u8> {
    let mut frame = [0; FRAME_CHARS_MAX];
    framing.encode(unit, pdu, LINE_FEED, &mut frame).unwrap().to_vec()
}

/// A frame that arrives, and what has been sent of it.
struct Played<'p> {
    writer: FrameWriter<'p>,
    frame: Frame<'p>,
    sent: Sent,
}

impl Played<'_> {
    /// All that can be sent now.
    fn sent(&mut self) -> Vec<u8> {
        let mut all = Vec::new();
        loop {
            let part = self.sent.next(&self.frame, self.frame.filled().1);
            if part.is_empty() {
                return all;
            }
            all.extend_from_slice(&part);
        }
    }

    fn push(&mut self, pdu: &[u8], crc: &[u8]) -> Vec<u8> {
        self.writer.push(pdu).unwrap();
        crc.iter().for_each(|&byte| self.writer.push_crc(byte));
        self.sent()
    }

    /// The frame proves good, or breaks off; what is sent then, and whether all that was sent may be taken for a frame.
    fn end(self, good: bool) -> (Vec<u8>, bool) {
        let Self { writer, frame, mut sent } = self;
        if good {
            assert!(writer.finish())
        } else {
            drop(writer)
        }
        let end = sent.next(&frame, frame.filled().1);
        (end.to_vec(), sent.is_frame(&frame))
    }
}

fn played<R>(framing: Framing, (from, to): (u8, u8), play: impl FnOnce(Played<'_>) -> R) -> R {
    let slots = [Slot::new()];
    let pool = FramePool::new(&slots, 0);
    let (writer, frame) = pool.take(0).unwrap();
    let form = Form { framing, may_wait: true, delimiter: LINE_FEED, source: None, from, to };
    play(Played { writer, frame, sent: Sent::new(form) })
}

#[test]
fn characters_leave_as_they_come_and_nothing_that_makes_the_frame_good_before_it_is() {
    for (framing, units) in [Framing::Rtu, Framing::Ascii].into_iter().flat_map(|f| UNITS.map(|u| (f, u))) {
        let is_rtu = framing == Framing::Rtu;
        let wanted = encoded(framing, units.1, &READ);
        let crc = rtu::check(units.0, &READ).to_le_bytes();
        played(framing, units, |mut copy| {
            let mut rest = &wanted[..];
            let mut is_next = |part: &[u8], count: usize| {
                let (wanted, behind) = rest.split_at(count);
                assert_eq!(part, wanted, "{framing:?} {units:?}");
                rest = behind;
            };
            is_next(&copy.sent(), if is_rtu { 1 } else { 3 });
            for byte in READ {
                is_next(&copy.push(&[byte], &[]), if is_rtu { 1 } else { 2 });
            }
            is_next(&copy.push(&[], &crc[..1]), usize::from(is_rtu));
            is_next(&copy.push(&[], &crc[1..]), if is_rtu { 0 } else { 2 });
            is_next(&copy.end(true).0, if is_rtu { 1 } else { 2 });
        });
    }
}

#[test]
fn what_comes_at_once_leaves_in_parts() {
    for (framing, held_back) in [(Framing::Rtu, 1), (Framing::Ascii, 2)] {
        let wanted = encoded(framing, 5, &LONG);
        let begin = &wanted[..wanted.len() - held_back];
        let crc = rtu::check(105, &LONG).to_le_bytes();
        played(framing, UNITS[1], |mut copy| assert_eq!(copy.push(&LONG, &crc), begin));
        // An ASCII frame that is read with its end has no CRC.
        played(framing, UNITS[1], |mut copy| {
            let begin = copy.push(&LONG, &[]);
            assert_eq!([&begin[..], &copy.end(true).0].concat(), wanted);
        });
    }
}

#[test]
fn what_was_corrupt_goes_on_to_a_wrong_end_and_what_breaks_off_stops() {
    let good = rtu::check(105, &READ).to_le_bytes();
    let bad = [good[0], !good[1]];
    let rtu = encoded(Framing::Rtu, 5, &READ);
    let [.., high, low, _, _] = encoded(Framing::Ascii, 5, &READ)[..] else { panic!("no frame") };
    let lrc = !u8::from_str_radix(core::str::from_utf8(&[high, low]).unwrap(), 16).unwrap();
    let wrong_lrc = [&digits(lrc)[..], b"\r\n"].concat();
    let cases: [(Framing, &[u8], &[u8]); 6] = [
        (Framing::Rtu, &bad, &[rtu[6], !rtu[7]]),
        (Framing::Ascii, &bad, &wrong_lrc),
        (Framing::Rtu, &good, &rtu[6..7]),
        (Framing::Ascii, &good, &[high, low]),
        (Framing::Rtu, &bad[..1], &rtu[6..7]),
        (Framing::Ascii, &bad[..1], &[]),
    ];
    for (framing, crc, wanted) in cases {
        played(framing, UNITS[1], |mut copy| {
            copy.push(&READ, &[]);
            let begin = copy.push(&[], crc);
            let (end, is_frame) = copy.end(false);
            assert_eq!([begin, end].concat(), wanted, "{framing:?} {crc:02x?}");
            assert!(!is_frame);
        });
    }
}

#[test]
fn what_the_board_has_sent_by_itself_is_not_sent_again() {
    let (came, wanted) = (encoded(Framing::Rtu, 105, &READ), encoded(Framing::Rtu, 5, &READ));
    for ahead in 0..=5 {
        played(Framing::Rtu, UNITS[1], |mut copy| {
            copy.writer.expect(READ.len());
            assert_eq!(copy.push(&READ[..1], &[]), wanted[..2]);
            let mut relay = copy.sent.relay(&copy.frame).expect("six characters are left");
            let relayed = came[2..].iter().filter_map(|&byte| relay.step(byte));
            assert!(relayed.eq(wanted[2..7].iter().copied()) && relay.is_over());
            copy.sent.ahead = ahead;
            let begin = copy.push(&READ[1..], &came[6..]);
            let end = copy.end(true).0;
            assert_eq!([&begin[..], &end].concat(), wanted[2 + ahead..], "{ahead} ahead");
        });
    }
}

#[test]
fn the_board_is_given_no_part_of_a_crc_alone() {
    for (there, is_given) in [(4, true), (5, false)] {
        played(Framing::Rtu, UNITS[1], |mut copy| {
            copy.writer.expect(READ.len());
            copy.push(&READ[..there], &[]);
            assert_eq!(copy.sent.relay(&copy.frame).is_some(), is_given, "{there} bytes of the PDU");
        });
    }
}

#[test]
fn a_copy_that_broke_off_behind_a_good_crc_may_have_been_taken_for_a_frame() {
    // A write whose data begin with the CRC of what is before them.
    let begin = encoded(Framing::Rtu, 5, &[16, 0, 50, 0, 4, 8]);
    let (pdu, last) = (&begin[1..], &begin[1..begin.len() - 1]);
    let is_frame = |framing, pdu: &[u8], crc: &[u8], later: &[u8], ahead| {
        played(framing, UNITS[0], |mut copy| {
            copy.push(pdu, crc);
            copy.writer.push(later).unwrap();
            copy.sent.ahead = ahead;
            copy.end(false).1
        })
    };
    assert!(is_frame(Framing::Rtu, pdu, &[], &[], 0));
    assert!(is_frame(Framing::Rtu, pdu, &[], &[1, 2], 0), "what came later was not sent");
    assert!(is_frame(Framing::Rtu, last, &begin[begin.len() - 1..], &[], 0), "half of its CRC was sent");
    assert!(!is_frame(Framing::Rtu, last, &[], &[], 0));
    assert!(!is_frame(Framing::Rtu, last, &[], &pdu[last.len()..], 0), "what came later was not sent");
    assert!(is_frame(Framing::Rtu, last, &[], &[], 1), "nobody knows what the board has sent");
    assert!(!is_frame(Framing::Ascii, pdu, &[], &[], 0), "no end, no frame");
}
