//! Frames that are passed on while they arrive: the arithmetic by value, the whole in virtual time.

use embassy_time::{Duration, Instant};
use mobgate::config::{Framing, LineSettings};
use mobgate::modbus::delta::CrcDelta;
use mobgate::modbus::pdu::{End, request_end, response_end};
use mobgate::port::cut::{Lane, start};
use mobgate::stats::Event;
use mobgate_simulator::client::{Answer, Reply};
use mobgate_simulator::device::rtu;
use mobgate_simulator::fault::When;
use mobgate_simulator::rig::machine;
use mobgate_simulator::{Device, Fault, Faults, Rig, World, rig};
use proptest::prelude::{any, prop};
use proptest::{prop_assert_eq, proptest};

const READ: [u8; 5] = [3, 0, 7, 0, 1];
/// A second, as any time at which a frame begins.
const BEGUN: Instant = Instant::from_ticks(1_000_000);

fn line(baud: u32) -> LineSettings {
    LineSettings { baud, ..LineSettings::DEFAULT }
}

fn rtu_lane(baud: u32) -> Lane {
    Lane { framing: Framing::Rtu, line: line(baud) }
}

fn ascii_lane(baud: u32) -> Lane {
    Lane { framing: Framing::Ascii, line: LineSettings { data_bits: 7, ..line(baud) } }
}

/// Microseconds from the first bit of a frame of `bytes` bytes without its check to that of its copy.
fn start_us(input: &Lane, output: &Lane, bytes: Option<usize>) -> Option<u64> {
    start(BEGUN, input, output, bytes).map(|at| (at - BEGUN).as_micros())
}

#[test]
fn a_copy_on_a_line_as_slow_or_slower_begins_as_soon_as_the_unit_is_there() {
    assert_eq!(start_us(&rtu_lane(19_200), &rtu_lane(19_200), None), Some(573));
    assert_eq!(start_us(&rtu_lane(115_200), &rtu_lane(19_200), None), Some(96));
    let none = LineSettings { parity: mobgate::config::Parity::None, ..line(19_200) };
    let none = Lane { framing: Framing::Rtu, line: none };
    // Ten bits a character are sooner over than eleven.
    assert_eq!(start_us(&none, &rtu_lane(19_200), None), Some(521));
    assert_eq!(start_us(&rtu_lane(19_200), &none, None), None);
    // Two characters of ten bits for one of eleven.
    assert_eq!(start_us(&rtu_lane(19_200), &ascii_lane(19_200), None), Some(573));
    assert_eq!(start_us(&ascii_lane(19_200), &ascii_lane(19_200), None), Some(1_563), "colon and two digits");
    assert_eq!(start_us(&ascii_lane(115_200), &rtu_lane(19_200), None), Some(261));
}

#[test]
fn a_copy_on_a_faster_line_begins_so_late_that_it_never_has_to_wait() {
    assert_eq!(start_us(&rtu_lane(9_600), &rtu_lane(115_200), None), None, "not before the length is known");
    // 8 characters of 1145.83 us less 7 of 95.49 us.
    assert_eq!(start_us(&rtu_lane(9_600), &rtu_lane(115_200), Some(6)), Some(8_499));
    assert_eq!(start_us(&rtu_lane(19_200), &rtu_lane(38_400), Some(23)), Some(14_323 - 6_875));
    // 8 of 1145.83 us less 13 of 86.81 us: the LRC is known when the frame is over.
    assert_eq!(start_us(&rtu_lane(9_600), &ascii_lane(115_200), Some(6)), Some(8_039));
    // 17 of 1041.67 us less 7 of 1145.83 us: at equal speeds, ASCII is the slow one.
    assert_eq!(start_us(&ascii_lane(9_600), &rtu_lane(9_600), None), None);
    assert_eq!(start_us(&ascii_lane(9_600), &rtu_lane(9_600), Some(6)), Some(9_688));
    // 17 of 1041.67 us less 15 of 86.81 us.
    assert_eq!(start_us(&ascii_lane(9_600), &ascii_lane(115_200), Some(6)), Some(16_407));
}

/// When each character of a frame of `bytes` bytes and its copy may be there and must leave: the formula is the earliest
/// start at which none has to wait.
#[test]
fn the_start_is_the_earliest_at_which_no_character_has_to_wait() {
    let lanes = [1_200, 9_600, 19_200, 115_200].map(|baud| [rtu_lane(baud), ascii_lane(baud)]);
    let lanes = lanes.as_flattened();
    for (input, output) in lanes.iter().flat_map(|input| lanes.iter().map(move |output| (input, output))) {
        for bytes in [2, 3, 6, 23, 254] {
            let wanted = earliest_us(input, output, bytes);
            let start = start_us(input, output, Some(bytes)).unwrap() as f64;
            assert!((wanted..=wanted + 1.0).contains(&start), "{input:?} to {output:?}, {bytes}: {start}");
            if let Some(unknown) = start_us(input, output, None) {
                assert!(unknown as f64 >= wanted, "{input:?} to {output:?}, {bytes}: not known, {unknown}");
            }
        }
    }
}

/// The earliest start, character by character.
fn earliest_us(input: &Lane, output: &Lane, bytes: usize) -> f64 {
    // When a byte is there, when its check is, and when all is; in characters.
    let (there, check, end): (fn(usize) -> usize, _, _) = match input.framing {
        Framing::Rtu => (|byte| byte + 1, bytes + 2, bytes + 2),
        Framing::Ascii => (|byte| 2 * byte + 3, 2 * bytes + 3, 2 * bytes + 5),
    };
    let bytes_needed = (0..bytes).map(there);
    // The characters of the copy, each with what it needs of the frame.
    let needed: Vec<usize> = match (input.framing, output.framing) {
        (Framing::Rtu, Framing::Rtu) => bytes_needed.chain([bytes + 1, end]).collect(),
        (Framing::Ascii, Framing::Rtu) => bytes_needed.chain([check, end]).collect(),
        (_, Framing::Ascii) => {
            let digits = bytes_needed.flat_map(|needed| [needed; 2]);
            [there(0)].into_iter().chain(digits).chain([check, check, end, end]).collect()
        }
    };
    let us = |lane: &Lane| f64::from(lane.line.bits_per_char()) * 1e6 / f64::from(lane.line.baud);
    let starts = needed
        .iter()
        .enumerate()
        .map(|(place, &needed)| needed as f64 * us(input) - place as f64 * us(output));
    // The unit is there before anything is sent.
    starts.fold(there(0) as f64 * us(input), f64::max)
}

#[test]
fn the_beginning_of_a_request_tells_its_end_as_soon_as_it_can() {
    assert_eq!(request_end(&[]), End::Later);
    for function in 1..=6 {
        assert_eq!(request_end(&[function]), End::At(5));
    }
    assert_eq!(request_end(&[16, 0, 0, 0, 2]), End::Later);
    assert_eq!(request_end(&[16, 0, 0, 0, 2, 4]), End::At(10));
    assert_eq!(request_end(&[23, 0, 0, 0, 1, 0, 0, 0, 1]), End::Later);
    assert_eq!(request_end(&[23, 0, 0, 0, 1, 0, 0, 0, 1, 2]), End::At(12));
    assert_eq!(request_end(&[8, 0]), End::Later);
    assert_eq!(request_end(&[8, 0, 99]), End::Unknown);
    assert_eq!(request_end(&[65]), End::Unknown);
    assert_eq!(request_end(&[0x83]), End::Unknown);
    assert_eq!(request_end(&[16, 0, 0, 0, 2, 255]), End::Unknown, "no frame is that long");
}

#[test]
fn the_beginning_of_a_response_tells_its_end_or_that_it_is_none() {
    assert_eq!(response_end(&READ, &[]), End::Later);
    assert_eq!(response_end(&READ, &[3]), End::At(4));
    assert_eq!(response_end(&READ, &[3, 2]), End::At(4));
    assert_eq!(response_end(&READ, &[3, 4]), End::Unknown, "another byte count");
    assert_eq!(response_end(&READ, &[4]), End::Unknown, "another function");
    assert_eq!(response_end(&READ, &[0x83]), End::At(2));
    assert_eq!(response_end(&READ, &[0x83, 0]), End::Unknown);
    assert_eq!(response_end(&[16, 0, 0, 0, 1, 2, 0, 0], &[16]), End::At(5));
    assert_eq!(response_end(&[65, 1], &[65]), End::Unknown);
}

proptest! {
    #[test]
    fn another_units_id_turns_the_same_bits_of_the_crc_wrong_as_before(
        pdu in prop::collection::vec(any::<u8>(), 1..=253),
        from in any::<u8>(),
        to in any::<u8>(),
        damage in any::<u16>(),
    ) {
        let crc = |unit| {
            let frame = rtu::frame(unit, &pdu);
            u16::from_le_bytes([frame[frame.len() - 2], frame[frame.len() - 1]])
        };
        let mut delta = CrcDelta::new(from, to);
        delta.pass(pdu.len());
        let sent = u16::from_le_bytes(delta.translate((crc(from) ^ damage).to_le_bytes()));
        prop_assert_eq!(sent, crc(to) ^ damage);
    }
}

/// A server line in front of a client line with the devices 5 and 6, which the master calls 105 and 106.
fn played(up: u32, down: u32, rule: &str, play: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &[Device; 2])) {
    let settings = format!(
        "port S serial up rtu server {up} 8E1\nport C serial down rtu client {down} 8E1 timeout 100ms\n\
         port T tcp server 502\nroute S 101-109 * -100 C {rule}\nroute T * * * C\n"
    );
    rig::with_gateway(1, &settings, |world, rig| {
        let devices = [Device::new(5), Device::new(6)];
        rig.attach(world, "down", devices.clone());
        world.run_for(Duration::from_secs(1));
        play(world, rig, &devices);
        world.run_for(Duration::from_secs(10));
        assert_eq!(rig.frames_in_use(), 0);
        assert_eq!(rig.wire("up").collisions() + rig.wire("down").collisions(), 0);
        for device in devices {
            assert_eq!(device.counters().gap_inside, 0, "no copy has a gap");
        }
    });
}

fn damaged() -> Answer {
    Answer::Wrong(Reply { transaction: 0, protocol: 0, unit: 0, pdu: Vec::new() })
}

/// How often port `name` sent a frame while it arrived, sent a whole one, and broke one off.
fn counts(rig: &Rig<'_>, name: &str) -> [u32; 3] {
    [Event::Cut, Event::Stored, Event::Aborted].map(|event| rig.counted(name, event))
}

#[test]
fn frames_are_passed_on_in_both_directions_while_they_arrive_at_all_pairs_of_speeds() {
    let speeds = [1_200, 9_600, 19_200, 38_400, 115_200];
    for (up, down) in speeds.into_iter().flat_map(|up| speeds.map(|down| (up, down))) {
        played(up, down, "", |world, rig, devices| {
            let mut master = rig.master("up");
            let write = [16, 0, 50, 0, 3, 6, 1, 2, 3, 4, 5, 6];
            let requests: [(&[u8], &[u8]); 4] = [
                (&READ, &[3, 2, 5, 7]),
                (&write, &write[..5]),
                (&[3, 0, 50, 0, 3], &[3, 6, 1, 2, 3, 4, 5, 6]),
                (&[3, 0xff, 0, 0, 1], &[0x83, 2]),
            ];
            for (request, answer) in requests {
                let heard = world.run_until(master.request(105, request));
                assert_eq!(heard, Answer::Pdu(answer.to_vec()), "{up} to {down}");
                world.run_for(Duration::from_millis(50));
            }
            assert_eq!(counts(rig, "C"), [4, 0, 0], "{up} to {down}");
            assert_eq!(counts(rig, "S")[2], 0, "{up} to {down}");
            assert_eq!(devices[0].counters().bad_crc, 0);
        });
    }
}

#[test]
fn a_rule_can_have_frames_stored() {
    played(19_200, 19_200, "cut off", |world, rig, _| {
        let answer = world.run_until(rig.master("up").request(105, &READ));
        assert_eq!(answer, Answer::Pdu(vec![3, 2, 5, 7]));
        assert_eq!((counts(rig, "C"), counts(rig, "S")), ([0, 1, 0], [0, 1, 0]));
    });
}

#[test]
fn what_a_rule_refuses_never_reaches_the_other_line() {
    for rule in ["readonly", "writes 0-10", "addresses 0-10"] {
        played(19_200, 19_200, rule, |world, rig, _| {
            let mut master = rig.master("up");
            let answer = world.run_until(master.request(105, &[6, 0, 50, 1, 2]));
            assert!(matches!(answer, Answer::Pdu(pdu) if pdu[0] == 0x86), "{rule}");
            assert_eq!(rig.sent("down").characters, 0, "{rule}");
            // What it allows is passed on while it arrives, as soon as that is seen.
            assert_eq!(world.run_until(master.request(105, &READ)), Answer::Pdu(vec![3, 2, 5, 7]), "{rule}");
            assert_eq!(counts(rig, "C"), [1, 0, 0], "{rule}");
        });
    }
}

#[test]
fn a_damaged_request_stays_damaged_and_costs_the_unit_nothing() {
    for (up, down) in [(19_200, 19_200), (9_600, 115_200), (115_200, 9_600)] {
        played(up, down, "", |world, rig, devices| {
            let mut master = rig.master("up");
            for at in 2..8 {
                let mut frame = rtu::frame(105, &READ);
                frame[at] ^= 0x10;
                world.run_until(master.send_bytes(&frame));
                world.run_for(Duration::from_millis(100));
            }
            assert_eq!(devices[0].counters().all_requests(), 0);
            assert_eq!(devices[0].counters().bad_crc, 6, "the device has seen every one of them");
            assert_eq!(counts(rig, "C"), [6, 0, 6]);
            assert_eq!(rig.counted("C", Event::Timeout), 0);
            assert_eq!(world.run_until(master.request(105, &READ)), Answer::Pdu(vec![3, 2, 5, 7]));
        });
    }
}

#[test]
fn a_request_that_breaks_off_is_broken_off_on_the_other_line() {
    played(19_200, 19_200, "", |world, rig, devices| {
        let mut master = rig.master("up");
        for length in 1..8 {
            world.run_until(master.send_bytes(&rtu::frame(105, &READ)[..length]));
            world.run_for(Duration::from_millis(50));
        }
        assert_eq!(devices[0].counters().all_requests(), 0);
        assert_eq!(counts(rig, "C"), [7, 0, 7]);
        assert_eq!(world.run_until(master.request(105, &READ)), Answer::Pdu(vec![3, 2, 5, 7]));
    });
}

#[test]
fn a_malformed_request_is_broken_off_and_answered_by_the_gateway() {
    played(19_200, 19_200, "", |world, rig, devices| {
        // 126 registers are more than a read may ask for.
        let answer = world.run_until(rig.master("up").request(105, &[3, 0, 0, 0, 126]));
        assert_eq!(answer, Answer::Pdu(vec![0x83, 3]));
        assert_eq!(devices[0].counters().all_requests(), 0);
        assert_eq!(counts(rig, "C"), [1, 0, 1]);
    });
}

#[test]
fn a_response_that_does_not_fit_never_gets_its_last_character() {
    for (up, down) in [(19_200, 19_200), (9_600, 115_200), (115_200, 9_600)] {
        for fault in
            [Fault::WrongFunction, Fault::WrongLength, Fault::WrongEcho, Fault::BadCrc, Fault::Truncated]
        {
            played(up, down, "", |world, rig, devices| {
                devices[0].set_faults(Faults::new(1).with(When::Requests(1..=1), fault));
                let mut master = rig.master("up");
                let answer = world.run_until(master.request(105, &[6, 0, 50, 1, 2]));
                let stored = Answer::Pdu(vec![0x86, 0x0b]);
                assert!([damaged(), Answer::Silence, stored].contains(&answer), "{fault:?}: {answer:?}");
                world.run_for(Duration::from_millis(300));
                let answer = world.run_until(master.request(105, &READ));
                assert_eq!(answer, Answer::Pdu(vec![3, 2, 5, 7]), "{up} to {down}, after {fault:?}");
            });
        }
    }
}

#[test]
fn functions_of_unknown_length_are_stored_and_begun_at_most_once() {
    played(19_200, 19_200, "", |world, rig, _| {
        let mut master = rig.master("up");
        for _ in 0..3 {
            let answer = world.run_until(master.request(105, &[65, 1, 2]));
            assert_eq!(answer, Answer::Pdu(vec![65, 1, 2, !65]));
        }
        assert_eq!(counts(rig, "C"), [1, 3, 1]);
    });
}

#[test]
fn a_frame_for_a_busy_line_is_stored_or_passed_on_late() {
    played(9_600, 9_600, "", |world, rig, _| {
        let (mut master, mut client) = (rig.master("up"), rig.client(machine(1), 502));
        for late_ms in [0, 10, 20, 30, 35, 40, 45, 50] {
            let others = async {
                embassy_time::Timer::after_millis(60 - late_ms).await;
                client.request(6, &[3, 0, 0, 0, 10]).await
            };
            let ours = async {
                embassy_time::Timer::after_millis(60).await;
                master.request(105, &READ).await
            };
            let (others, ours) = world.run_until(embassy_futures::join::join(others, ours));
            assert!(matches!(others, Answer::Pdu(_)));
            assert_eq!(ours, Answer::Pdu(vec![3, 2, 5, 7]));
        }
        let [cut, stored, aborted] = counts(rig, "C");
        assert!(cut > 0 && stored > 0 && aborted == 0, "{cut} {stored} {aborted}");
    });
}

#[test]
fn a_unit_that_is_down_is_refused_though_its_request_was_passed_on_early() {
    played(19_200, 19_200, "", |world, rig, _| {
        let mut master = rig.master("up");
        let answers: Vec<_> = (0..5).map(|_| world.run_until(master.request(109, &READ))).collect();
        let refused = Answer::Pdu(vec![0x83, 0x0b]);
        assert!(answers.iter().all(|answer| *answer == refused), "{answers:?}");
        assert_eq!(rig.counted("C", Event::Timeout), 3);
    });
}
