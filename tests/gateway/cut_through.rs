//! Frames that are passed on while they arrive, from RTU line to RTU line, in virtual time.

use embassy_time::{Duration, Instant};
use mobgate::settings::Framing;
use mobgate::stats::Event;
use mobgate_simulator::client::load::ClosedLoop;
use mobgate_simulator::client::{Answer, Reply};
use mobgate_simulator::device::rtu;
use mobgate_simulator::fault::When;
use mobgate_simulator::rig::{Size, machine};
use mobgate_simulator::timing::t1_5_ns;
use mobgate_simulator::{Device, Fault, Faults, Rig, World, rig};

pub(crate) const READ: [u8; 5] = [3, 0, 7, 0, 1];
/// Two RTU lines.
fn played(up: u32, down: u32, rule: &str, play: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &[Device; 2])) {
    between((Framing::Rtu, up), (Framing::Rtu, down), rule, play);
}

/// A server line in front of a client line with the devices 5 and 6, which the master calls 105 and 106.
pub(crate) fn between(
    up: (Framing, u32),
    down: (Framing, u32),
    rule: &str,
    play: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &[Device; 2]),
) {
    let format = |framing| if framing == Framing::Rtu { "8E1" } else { "7E1" };
    let settings = format!(
        "port S serial up {} server {} {}\nport C serial down {} client {} {} timeout 100ms\n\
         port T tcp server 502\nroute S 101-109 * -100 C {rule}\nroute T * * * C\n",
        up.0,
        up.1,
        format(up.0),
        down.0,
        down.1,
        format(down.0)
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

pub(crate) fn damaged() -> Answer {
    Answer::Wrong(Reply { transaction: 0, protocol: 0, unit: 0, pdu: Vec::new() })
}

/// How often port `name` sent a frame while it arrived, sent a whole one, and broke one off.
pub(crate) fn counts(rig: &Rig<'_>, name: &str) -> [u32; 3] {
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
fn the_board_relays_all_of_a_frame_between_its_header_and_its_last_character() {
    played(19_200, 19_200, "", |world, rig, devices| {
        let mut write = vec![16, 0, 0, 0, 120, 240];
        write.extend([0x55; 240]);
        let answer = world.run_until(rig.master("up").request(105, &write));
        assert_eq!(answer, Answer::Pdu(write[..5].to_vec()));
        assert_eq!(devices[0].memory().holding[119], 0x5555);
        // Behind the unit, six bytes tell the length; of the CRC one half is left.
        assert_eq!(rig.end("up").relayed_chars(), 240 + 2);
        // As soon as the response's function is there it can only be of one length.
        assert_eq!(rig.end("down").relayed_chars(), 4 + 2);
    });
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
fn what_answers_a_request_that_broke_off_where_it_looked_whole_is_no_answer_to_the_next_one() {
    played(19_200, 19_200, "", |world, rig, devices| {
        // A write whose first data happen to be the CRC of what the device's line has seen of it: the device takes it for a
        // frame, and refuses it late.
        devices[0].set_faults(
            Faults::new(1).with(
                When::Requests(1..=1),
                Fault::Late(Duration::from_millis(60), Duration::from_millis(60)),
            ),
        );
        let mut begin = rtu::frame(5, &[16, 0, 50, 0, 4, 8]);
        begin[0] = 105;
        let mut master = rig.master("up");
        world.run_until(master.send_bytes(&begin));
        world.run_for(Duration::from_millis(10));
        let answer = world.run_until(master.request(105, &[16, 0, 50, 0, 1, 2, 1, 2]));
        assert_eq!(answer, Answer::Pdu(vec![16, 0, 50, 0, 1]));
        assert_eq!(devices[0].counters().requests[16], 2, "the device has heard two requests");
        assert_eq!(counts(rig, "C")[2], 1);
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
        // Two of them waited for a proof that did not come.
        assert_eq!((rig.counted("C", Event::Timeout), rig.counted("C", Event::Proof)), (1, 2));
    });
}

#[test]
fn an_answer_that_pauses_is_heard_to_its_end_where_reads_are_late() {
    let late_reads = Duration::from_micros(300);
    let size = Size { late_reads, ..Size::default() };
    for (down, registers) in [(9_600, 4), (38_400, 4), (115_200, 1)] {
        let settings = format!(
            "port S serial up rtu server 38400\nport C serial down rtu client {down} timeout 50ms retries 0\n\
             port T tcp server 502\nroute S * * * C cut on\nroute T * * * C\n"
        );
        rig::with_gateway_of(size, 1, &settings, |world, rig| {
            let (device, other) = (Device::new(5), Device::new(6));
            rig.attach(world, "down", [device.clone(), other]);
            let mut client = rig.client(machine(1), 502);
            world.spawn(async move {
                let load = ClosedLoop::until(Instant::MAX);
                load.run(&mut client, || (6, READ.to_vec()), |_, _, _| {}).await
            });
            let mut master = rig.master("up");
            let t1_5_us = t1_5_ns(&rig.end("down").line()) / 1_000;
            for pause_us in (0..1_900).step_by(20) {
                let pause = Fault::GapInside(Duration::from_micros(pause_us));
                device.set_faults(Faults::new(1).with(When::Always, pause));
                let answer = world.run_until(master.request(5, &[3, 0, 7, 0, registers]));
                let is_good = matches!(answer, Answer::Pdu(pdu) if pdu[..2] == [3, 2 * registers]);
                // A longer pause ends what the board relays, and spoils an RTU frame.
                assert!(is_good || pause_us >= t1_5_us, "{down}, a pause of {pause_us} us");
                world.run_for(Duration::from_millis(20));
            }
            assert!(counts(rig, "S")[0] > 0);
            let end = (rig.end("down"), Framing::Rtu);
            let hasty = rig.wire("down").hasty_frames(end, late_reads, Duration::from_ticks(0));
            assert_eq!(hasty, [], "{down}: requests in an answer that pauses");
        });
    }
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
                assert_eq!(world.run_until(client.request(6, &READ)), Answer::Pdu(vec![3, 2, 6, 7]));
                let took = asked.elapsed();
                assert!(
                    took < Duration::from_millis(150),
                    "{length} bytes of {what} from {up} to {down}: {took}"
                );
                world.run_for(Duration::from_secs(1));
            };
            let request = rtu::frame(5, &[16, 0, 7, 0, 4, 8, 1, 2, 3, 4, 5, 6, 7, 8]);
            for length in 1..request.len() {
                world.run_until(master.send_bytes(&request[..length]));
                is_free(world, "a request", length);
            }
            for length in 1..13 {
                // What follows a damaged response is not passed on.
                device.set_faults(Faults::none());
                world.run_until(master.request(5, &READ));
                world.run_for(Duration::from_millis(100));
                device.set_faults(Faults::new(1).with(When::Always, Fault::CutTo(length)));
                world.run_until(master.send(5, &[3, 0, 7, 0, 4]));
                is_free(world, "an answer", length);
            }
            assert!(counts(rig, "S")[0] > 0 && counts(rig, "C")[0] > 0);
        });
    }
}
