//! Frames that are passed on while they arrive, from line to line of either framing: when a copy may begin, by value, and what
//! becomes of requests, in virtual time.

use embassy_futures::join::join;
use mobgate::port::cut_through::timing::start;
use mobgate::settings::{Lane, LineSettings, Parity};
use mobgate_simulator::timing::{char_bits, chars_ns};

use crate::prelude::*;

/// The response of device 5.
pub(crate) const VALUE: [u8; 4] = [3, 2, 5, 7];
/// Its registers that differ at every read.
pub(crate) const FRESH: u16 = 100;
/// From RTU, then from ASCII, to each.
pub(crate) const PAIRS: [(Framing, Framing); 4] = [
    (Framing::Rtu, Framing::Rtu),
    (Framing::Rtu, Framing::Ascii),
    (Framing::Ascii, Framing::Rtu),
    (Framing::Ascii, Framing::Ascii),
];
pub(crate) const SPEEDS: [(u32, u32); 3] = [(19_200, 19_200), (9_600, 115_200), (115_200, 9_600)];
/// Longer than an ASCII frame may pause.
pub(crate) const ASCII_OVERDUE: Duration = Duration::from_millis(1_100);

/// Settings of a port on a line: its framing and speed, and the character format that goes with them.
pub(crate) fn serial(framing: Framing, side: &str, baud: u32) -> String {
    format!("{framing} {side} {baud} {}", if framing == Framing::Rtu { "8E1" } else { "7E1" })
}

/// Two RTU lines.
fn played(up: u32, down: u32, rule: &str, play: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &[Device; 2])) {
    between((Framing::Rtu, up), (Framing::Rtu, down), rule, play);
}

/// A server line and a TCP server in front of a client line with the devices 5 and 6, which the master calls 105 and 106.
pub(crate) fn between(
    up: (Framing, u32),
    down: (Framing, u32),
    rule: &str,
    play: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &[Device; 2]),
) {
    let settings = format!(
        "port S serial up {}\nport C serial down {} timeout 100ms\nport T tcp server 502\n\
         route S 101-109 * -100 C {rule}\nroute T * * * C {rule}\n",
        serial(up.0, "server", up.1),
        serial(down.0, "client", down.1)
    );
    rig::with_gateway(1, &settings, |world, rig| {
        let devices = [Device::new(5).with_fresh(FRESH), Device::new(6)];
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

/// These pairs of framings at all these pairs of speeds; `play` is told which, and how the master speaks.
pub(crate) fn pairs(
    framings: &[(Framing, Framing)],
    speeds: &[(u32, u32)],
    rule: &str,
    mut play: impl for<'w> FnMut(&str, Framing, &mut World<'w>, &Rig<'w>, &[Device; 2]),
) {
    for (&(up, down), &(fast, slow)) in
        framings.iter().flat_map(|pair| speeds.iter().map(move |speed| (pair, speed)))
    {
        let case = format!("{up} {fast} to {down} {slow}");
        between((up, fast), (down, slow), rule, |world, rig, devices| play(&case, up, world, rig, devices));
    }
}

/// A good request is answered.
pub(crate) fn is_well(case: &str, world: &mut World<'_>, master: &mut Master) {
    world.run_for(Duration::from_millis(50));
    assert_eq!(world.run_until(master.request(105, &READ)), Response::Pdu(VALUE.to_vec()), "{case}");
}

/// How often port `name` sent a frame while it arrived, sent a whole one, and broke one off.
pub(crate) fn counts(rig: &Rig<'_>, name: &str) -> [u32; 3] {
    [Event::Cut, Event::Stored, Event::Aborted].map(|event| rig.counted(name, event))
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
fn frames_are_passed_on_in_both_directions_between_all_pairs_of_framings_and_speeds() {
    let speeds = [1_200, 9_600, 19_200, 38_400, 115_200];
    let speeds = speeds.map(|up| speeds.map(|down| (up, down)));
    pairs(&PAIRS, speeds.as_flattened(), "", |case, _, world, rig, devices| {
        let mut master = rig.master("up");
        let write = [16, 0, 50, 0, 3, 6, 1, 2, 3, 4, 5, 6];
        let requests: [(&[u8], &[u8]); 4] = [
            (&READ, &VALUE),
            (&write, &write[..5]),
            (&[3, 0, 50, 0, 3], &[3, 6, 1, 2, 3, 4, 5, 6]),
            (&[3, 0xff, 0, 0, 1], &[0x83, 2]),
        ];
        for (request, pdu) in requests {
            assert_eq!(world.run_until(master.request(105, request)), Response::Pdu(pdu.to_vec()), "{case}");
            world.run_for(Duration::from_millis(50));
        }
        assert_eq!(counts(rig, "C"), [4, 0, 0], "{case}");
        let [cut, stored, aborted] = counts(rig, "S");
        // On a slow upper line a response may be whole before the silence behind its request is over.
        let (up, down) = (rig.end("up").line().baud, rig.end("down").line().baud);
        let is_early = cut + stored == 4 && aborted == 0 && (cut == 4 || up < down);
        assert!(is_early, "{case}: {cut} {stored} {aborted}");
        assert_eq!(devices[0].counters().bad_crc, 0);
        ["up", "down"].into_iter().for_each(|wire| assert_no_pause(case, rig, wire));
    });
}

#[test]
fn the_board_relays_all_of_a_frame_between_its_header_and_its_last_character() {
    played(19_200, 19_200, "", |world, rig, devices| {
        let mut write = vec![16, 0, 0, 0, 120, 240];
        write.extend([0x55; 240]);
        let response = world.run_until(rig.master("up").request(105, &write));
        assert_eq!(response, Response::Pdu(write[..5].to_vec()));
        assert_eq!(devices[0].memory().holding[119], 0x5555);
        // Behind the unit, six bytes tell the length; of the CRC one half is left.
        assert_eq!(rig.end("up").relayed_chars(), 240 + 2);
        // As soon as the response's function is there it can only be of one length.
        assert_eq!(rig.end("down").relayed_chars(), 4 + 2);
    });
}

#[test]
fn a_request_with_any_bit_of_any_character_turned_is_never_carried_out() {
    pairs(&PAIRS, &SPEEDS, "", |case, up, world, rig, devices| {
        let frame = framing::frame(up, 105, &READ);
        let mut master = rig.master("up");
        for (at, bit) in (0..frame.len()).flat_map(|at| (0..7).map(move |bit| (at, bit))) {
            let mut corrupt = frame.clone();
            corrupt[at] ^= 1 << bit;
            world.run_until(master.send_bytes(&corrupt));
            world.run_for(Duration::from_millis(60));
        }
        for device in devices {
            assert_eq!(device.counters().all_requests(), 0, "{case}");
        }
        assert_eq!(rig.counted("C", Event::Timeout), 0, "{case}: nobody was waited for");
        let [cut, stored, aborted] = counts(rig, "C");
        let all_aborted = cut > frame.len() as u32 && stored == 0 && aborted == cut;
        assert!(all_aborted, "{case}: {cut} {stored} {aborted}");
        world.run_for(ASCII_OVERDUE);
        is_well(case, world, &mut master);
    });
}

#[test]
fn a_corrupt_request_stays_corrupt_and_costs_the_unit_nothing() {
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
            assert_eq!(world.run_until(master.request(105, &READ)), Response::Pdu(VALUE.to_vec()));
        });
    }
}

#[test]
fn a_corrupt_check_goes_on_as_a_wrong_check() {
    pairs(&PAIRS, &SPEEDS, "", |case, up, world, rig, devices| {
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
    pairs(&PAIRS, &SPEEDS, "", |case, up, world, rig, devices| {
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
fn what_answers_a_request_that_broke_off_where_it_looked_whole_is_no_response_to_the_next_one() {
    played(19_200, 19_200, "", |world, rig, devices| {
        // A write whose first data happen to be the CRC of what the device's line has seen of it: the device takes it for a
        // frame, and refuses it late.
        let late = Fault::Late(Duration::from_millis(60), Duration::from_millis(60));
        devices[0].set_faults(Faults::new(1).with(When::Requests(1..=1), late));
        let mut begin = rtu::frame(5, &[16, 0, 50, 0, 4, 8]);
        begin[0] = 105;
        let mut master = rig.master("up");
        world.run_until(master.send_bytes(&begin));
        world.run_for(Duration::from_millis(10));
        let response = world.run_until(master.request(105, &[16, 0, 50, 0, 1, 2, 1, 2]));
        assert_eq!(response, Response::Pdu(vec![16, 0, 50, 0, 1]));
        assert_eq!(devices[0].counters().requests[16], 2, "the device has heard two requests");
        assert_eq!(counts(rig, "C")[2], 1);
    });
}

#[test]
fn a_frame_for_a_busy_line_is_stored_or_passed_on_late() {
    pairs(&PAIRS, &[(9_600, 9_600), (9_600, 19_200)], "", |case, _, world, rig, _| {
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
            assert!(matches!(others, Response::Pdu(_)), "{case}");
            assert_eq!(ours, Response::Pdu(VALUE.to_vec()), "{case}");
            world.run_for(Duration::from_millis(100));
        }
        let [cut, stored, aborted] = counts(rig, "C");
        assert!(cut > 0 && stored > 0 && aborted == 0, "{case}: {cut} {stored} {aborted}");
        ["up", "down"].into_iter().for_each(|wire| assert_no_pause(case, rig, wire));
    });
}

#[test]
fn a_frame_that_breaks_off_while_it_is_passed_on_holds_up_nobody() {
    for (up, down) in [(9_600, 38_400), (38_400, 9_600)] {
        let settings = format!(
            "port S serial up rtu server {up}\nport C serial down rtu client {down} timeout 50ms retries 0\n\
             port T tcp server 502\nroute S * * * C cut on\nroute T * * * C\n"
        );
        rig::with_gateway(1, &settings, |world, rig| {
            let device = Device::new(5);
            rig.attach(world, "down", [device.clone(), Device::new(6)]);
            let (mut master, mut client) = (rig.master("up"), rig.client(machine(1), 502));
            let mut is_free = |world: &mut World<'_>, what: &str, length| {
                let asked = Instant::now();
                assert_eq!(world.run_until(client.request(6, &READ)), Response::Pdu(vec![3, 2, 6, 7]));
                let took = asked.elapsed();
                let soon = took < Duration::from_millis(150);
                assert!(soon, "{length} bytes of {what} from {up} to {down}: {took}");
                world.run_for(Duration::from_secs(1));
            };
            let request = rtu::frame(5, &[16, 0, 7, 0, 4, 8, 1, 2, 3, 4, 5, 6, 7, 8]);
            for length in 1..request.len() {
                world.run_until(master.send_bytes(&request[..length]));
                is_free(world, "a request", length);
            }
            for length in 1..13 {
                // What follows a corrupt response is not passed on.
                device.set_faults(Faults::none());
                world.run_until(master.request(5, &READ));
                world.run_for(Duration::from_millis(100));
                device.set_faults(Faults::new(1).with(When::Always, Fault::CutTo(length)));
                world.run_until(master.send(5, &[3, 0, 7, 0, 4]));
                is_free(world, "a response", length);
            }
            assert!(counts(rig, "S")[0] > 0 && counts(rig, "C")[0] > 0);
        });
    }
}

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
    let none = LineSettings { parity: Parity::None, ..line(19_200) };
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
            assert!(
                (wanted - 1e-6..=wanted + 1.0).contains(&start),
                "{input:?} to {output:?}, {bytes}: {start}"
            );
            if let Some(unknown) = start_us(input, output, None) {
                assert!(
                    unknown as f64 >= wanted - 1e-6,
                    "{input:?} to {output:?}, {bytes}: not known, {unknown}"
                );
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
    let us = |lane: &Lane| char_bits(&lane.line) as f64 * 1e6 / f64::from(lane.line.baud);
    let starts = needed
        .iter()
        .enumerate()
        .map(|(place, &needed)| needed as f64 * us(input) - place as f64 * us(output));
    // The unit is there before anything is sent.
    starts.fold(there(0) as f64 * us(input), f64::max)
}
