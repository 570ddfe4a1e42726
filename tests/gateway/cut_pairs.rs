//! Frames that are passed on while they arrive between lines of either framing, in virtual time.

use embassy_futures::join::join;
use embassy_time::{Duration, Timer};
use mobgate::settings::Framing;
use mobgate::stats::Event;
use mobgate_simulator::client::Answer;
use mobgate_simulator::fault::When;
use mobgate_simulator::rig::machine;
use mobgate_simulator::timing::chars_ns;
use mobgate_simulator::{Device, Fault, Faults, Master, Rig, World, framing};

use super::cut_through::{READ, between, counts};

const PAIRS: [(Framing, Framing); 4] = [
    (Framing::Rtu, Framing::Rtu),
    (Framing::Rtu, Framing::Ascii),
    (Framing::Ascii, Framing::Rtu),
    (Framing::Ascii, Framing::Ascii),
];
pub(crate) const SPEEDS: [(u32, u32); 3] = [(19_200, 19_200), (9_600, 115_200), (115_200, 9_600)];
/// The response of device 5.
pub(crate) const VALUE: [u8; 4] = [3, 2, 5, 7];
/// Longer than an ASCII frame may pause.
const ASCII_OVERDUE: Duration = Duration::from_millis(1_100);

/// All pairs of framings at all pairs of `speeds`.
fn pairs(
    speeds: &[(u32, u32)],
    mut play: impl for<'w> FnMut(&str, Framing, &mut World<'w>, &Rig<'w>, &[Device; 2]),
) {
    for ((up, down), &(fast, slow)) in
        PAIRS.iter().flat_map(|pair| speeds.iter().map(move |speed| (pair, speed)))
    {
        let case = format!("{up} {fast} to {down} {slow}");
        between((*up, fast), (*down, slow), "", |world, rig, devices| play(&case, *up, world, rig, devices));
    }
}

/// A good request is answered.
pub(crate) fn is_well(case: &str, world: &mut World<'_>, master: &mut Master) {
    world.run_for(Duration::from_millis(50));
    let answer = world.run_until(master.request(105, &READ));
    assert_eq!(answer, Answer::Pdu(VALUE.to_vec()), "{case}");
}

#[test]
fn frames_are_passed_on_in_both_directions_between_all_pairs_of_framings_and_speeds() {
    let speeds = [1_200, 9_600, 19_200, 115_200];
    let speeds = speeds.map(|up| speeds.map(|down| (up, down)));
    pairs(speeds.as_flattened(), |case, _, world, rig, devices| {
        let mut master = rig.master("up");
        let write = [16, 0, 50, 0, 3, 6, 1, 2, 3, 4, 5, 6];
        let requests: [(&[u8], &[u8]); 4] = [
            (&READ, &VALUE),
            (&write, &write[..5]),
            (&[3, 0, 50, 0, 3], &[3, 6, 1, 2, 3, 4, 5, 6]),
            (&[3, 0xff, 0, 0, 1], &[0x83, 2]),
        ];
        for (request, answer) in requests {
            let heard = world.run_until(master.request(105, request));
            assert_eq!(heard, Answer::Pdu(answer.to_vec()), "{case}");
            world.run_for(Duration::from_millis(50));
        }
        assert_eq!(counts(rig, "C"), [4, 0, 0], "{case}");
        let [cut, stored, aborted] = counts(rig, "S");
        // On a slow upper line a response may be whole before the silence behind its request is over.
        let (up, down) = (rig.end("up").line().baud, rig.end("down").line().baud);
        assert!(
            cut + stored == 4 && aborted == 0 && (cut == 4 || up < down),
            "{case}: {cut} {stored} {aborted}"
        );
        assert_eq!(devices[0].counters().bad_crc, 0);
        ["up", "down"].into_iter().for_each(|wire| assert_no_pause(case, rig, wire));
    });
}

/// What the gateway has sent on `wire` has not waited for a character anywhere.
fn assert_no_pause(case: &str, rig: &Rig<'_>, wire: &str) {
    let end = rig.end(wire);
    let frames = rig.wire(wire).frames();
    for frame in frames.iter().filter(|frame| frame.from == end.number()) {
        let took = frame.end_ns - frame.start_ns;
        let length = chars_ns(&end.line(), frame.bytes.len() as u64);
        assert!(took <= length, "{case}: {took} ns for {:02x?}", frame.bytes);
    }
}

#[test]
fn a_request_with_any_bit_of_any_character_turned_is_never_carried_out() {
    pairs(&SPEEDS, |case, up, world, rig, devices| {
        let frame = framing::frame(up, 105, &READ);
        let mut master = rig.master("up");
        for (at, bit) in (0..frame.len()).flat_map(|at| (0..7).map(move |bit| (at, bit))) {
            let mut damaged = frame.clone();
            damaged[at] ^= 1 << bit;
            world.run_until(master.send_bytes(&damaged));
            world.run_for(Duration::from_millis(60));
        }
        for device in devices {
            assert_eq!(device.counters().all_requests(), 0, "{case}");
        }
        assert_eq!(rig.counted("C", Event::Timeout), 0, "{case}: nobody was waited for");
        let [cut, stored, aborted] = counts(rig, "C");
        assert!(
            cut > frame.len() as u32 && stored == 0 && aborted == cut,
            "{case}: {cut} {stored} {aborted}"
        );
        world.run_for(ASCII_OVERDUE);
        is_well(case, world, &mut master);
    });
}

#[test]
fn a_damaged_check_goes_on_as_a_wrong_check() {
    pairs(&SPEEDS, |case, up, world, rig, devices| {
        let mut frame = framing::frame(up, 105, &READ);
        // The last half of the CRC, or the last digit of the LRC.
        let at = if up == Framing::Rtu { frame.len() - 1 } else { frame.len() - 3 };
        frame[at] = if frame[at] == b'0' { b'1' } else { b'0' };
        let mut master = rig.master("up");
        world.run_until(master.send_bytes(&frame));
        world.run_for(Duration::from_millis(100));
        assert_eq!(devices[0].counters().bad_crc, 1, "{case}: the device has seen it");
        assert_eq!(counts(rig, "C"), [1, 0, 1], "{case}");
        is_well(case, world, &mut master);
    });
}

#[test]
fn a_request_that_breaks_off_anywhere_is_broken_off_on_the_other_line() {
    pairs(&SPEEDS, |case, up, world, rig, devices| {
        let frame = framing::frame(up, 105, &READ);
        let mut master = rig.master("up");
        for length in 1..frame.len() {
            world.run_until(master.send_bytes(&frame[..length]));
            world.run_for(ASCII_OVERDUE);
        }
        assert_eq!(devices[0].counters().all_requests(), 0, "{case}");
        let [cut, stored, aborted] = counts(rig, "C");
        assert!(cut > 0 && stored == 0 && aborted == cut, "{case}: {cut} {stored} {aborted}");
        is_well(case, world, &mut master);
    });
}

#[test]
fn a_malformed_request_is_broken_off_and_answered_by_the_gateway() {
    pairs(&SPEEDS, |case, _, world, rig, devices| {
        // 126 registers are more than a read may ask for.
        let answer = world.run_until(rig.master("up").request(105, &[3, 0, 0, 0, 126]));
        assert_eq!(answer, Answer::Pdu(vec![0x83, 3]), "{case}");
        assert_eq!(devices[0].counters().all_requests(), 0, "{case}");
        assert_eq!(counts(rig, "C"), [1, 0, 1], "{case}");
    });
}

#[test]
fn no_answer_that_was_damaged_or_does_not_fit_is_taken_for_a_good_one() {
    let write = [6, 0, 50, 1, 2];
    pairs(&SPEEDS, |case, _, world, rig, devices| {
        let kinds = [
            Fault::BadCrc,
            Fault::FlippedBit,
            Fault::LostByte,
            Fault::Truncated,
            Fault::WrongUnit,
            Fault::WrongFunction,
            Fault::WrongLength,
            Fault::WrongEcho,
        ];
        let mut master = rig.master("up").with_patience(Duration::from_secs(2));
        for (fault, nth) in kinds.into_iter().flat_map(|fault| (0..8).map(move |nth| (fault, nth))) {
            devices[0].set_faults(Faults::new(nth).with(When::Always, fault));
            let answer = world.run_until(master.request(105, &write));
            let taken = matches!(&answer, Answer::Pdu(pdu) if *pdu != [0x86, 0x0b]);
            assert!(!taken, "{case}, {fault:?}: {answer:?}");
            devices[0].set_faults(Faults::none());
            world.run_for(ASCII_OVERDUE);
            is_well(case, world, &mut master);
        }
        assert!(counts(rig, "S")[2] > 0, "{case}: answers were broken off");
    });
}

#[test]
fn a_frame_for_a_busy_line_is_stored_or_passed_on_late() {
    pairs(&[(9_600, 9_600), (9_600, 19_200)], |case, _, world, rig, _| {
        let (mut master, mut client) = (rig.master("up"), rig.client(machine(1), 502));
        for late_ms in (0..120).step_by(4) {
            let others = async {
                Timer::after_millis(120 - late_ms).await;
                client.request(6, &[3, 0, 0, 0, 10]).await
            };
            let ours = async {
                Timer::after_millis(120).await;
                master.request(105, &READ).await
            };
            let (others, ours) = world.run_until(join(others, ours));
            assert!(matches!(others, Answer::Pdu(_)), "{case}");
            assert_eq!(ours, Answer::Pdu(VALUE.to_vec()), "{case}");
            world.run_for(Duration::from_millis(100));
        }
        let [cut, stored, aborted] = counts(rig, "C");
        assert!(cut > 0 && stored > 0 && aborted == 0, "{case}: {cut} {stored} {aborted}");
        ["up", "down"].into_iter().for_each(|wire| assert_no_pause(case, rig, wire));
    });
}

#[test]
fn a_rule_can_have_frames_stored() {
    for (up, down) in PAIRS {
        between((up, 19_200), (down, 19_200), "cut off", |world, rig, _| {
            is_well("", world, &mut rig.master("up"));
            assert_eq!((counts(rig, "C"), counts(rig, "S")), ([0, 1, 0], [0, 1, 0]), "{up} to {down}");
        });
    }
}
