//! A master on a serial line asks the gateway, in virtual time.

use mobgate_simulator::shared_bus::torture;

use crate::prelude::*;

/// A server line of `server` in front of a client line of `client` with devices 5 and 6.
fn settings(server: &str, client: &str) -> String {
    format!("port S serial up {server}\nport C serial down {client}\nroute S 1-9 * * C\n")
}

fn played(server: &str, client: &str, play: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>)) {
    rig::with_gateway(1, &settings(server, client), |world, rig| {
        rig.attach(world, "down", [Device::new(5), Device::new(6)]);
        world.run_for(Duration::from_secs(1));
        play(world, rig);
        world.run_for(Duration::from_secs(10));
        assert_eq!(rig.frames_in_use(), 0);
        assert_eq!(rig.wire("up").collisions() + rig.wire("down").collisions(), 0);
    });
}

#[test]
fn rts_is_on_from_before_the_first_bit_until_after_the_last() {
    let rts = "19200 8E1 rts driver-before 200us driver-after 100us";
    played(&format!("rtu server {rts}"), &format!("rtu client {rts}"), |world, rig| {
        let mut master = rig.master("up");
        for unit in [5, 6, 5] {
            assert_eq!(world.run_until(master.request(unit, &READ)), Response::Pdu(vec![3, 2, unit, 7]));
        }
        for line in ["up", "down"] {
            let switched = rig.sent(line).switched;
            let frames = rig.wire(line).frames();
            let own = frames.iter().filter(|frame| frame.from == rig.end(line).number());
            let times: Vec<_> = own.flat_map(|frame| [frame.start_ns, frame.end_ns]).collect();
            assert_eq!(switched.len(), 6, "three frames on each line");
            for ((switched, on), at) in switched.into_iter().zip(times) {
                let ahead = if on { at - switched } else { switched - at };
                // The clock ticks in microseconds.
                let wanted = if on { 200_000 } else { 100_000 };
                assert!((wanted..=wanted + 2_000).contains(&ahead), "{line}: {ahead}");
            }
        }
    });
}

#[test]
fn a_board_that_rests_responds_at_the_same_moments_and_is_woken_less() {
    let write = [&[16, 0, 0, 0, 20, 40][..], &[0xab; 40]].concat();
    for (request, most) in [(&READ[..], 4), (&[6, 0, 1, 0xab, 0xcd], 4), (&write, 9)] {
        let [(awake, read), (resting, read_resting)] = [0, 20].map(|rests| {
            // A tick late, so that a request ends by its length, also where nobody rests.
            let late_reads = Duration::from_ticks(1);
            let size = Size { late_reads, rests: Duration::from_millis(rests), ..Size::default() };
            let settings =
                settings("rtu server 19200 8E1", "rtu client 115200 8N1").replace("* C", "* C cut off");
            let asked = format!("{request:02x?}, rests of {rests} ms");
            rig::with_gateway_of(size, 1, &settings, |world, rig| {
                rig.attach(world, "down", [Device::new(5)]);
                world.run_for(Duration::from_secs(1));
                let mut master = rig.master("up");
                let response = world.run_until(master.request(5, request));
                assert!(matches!(response, Response::Pdu(_)), "{asked}: {response:?}");
                (rig.wire("up").frames(), rig.sent("up").reads)
            })
        });
        assert_eq!(awake, resting, "{request:02x?}");
        assert!(read_resting <= most && most < read, "{request:02x?}: {read_resting} reads, {read} awake");
    }
}

/// The full count is among the figures of `cargo xtask bench`.
#[test]
fn on_a_shared_bus_nobody_elses_questions_are_answered_and_none_of_ours_is_missed() {
    let punctual = Duration::from_ticks(0);
    for (framing, late_reads, rests) in [
        (Framing::Rtu, punctual, punctual),
        (Framing::Ascii, punctual, punctual),
        (Framing::Rtu, Duration::from_millis(16), punctual),
        (Framing::Ascii, Duration::from_millis(16), punctual),
        (Framing::Rtu, punctual, Duration::from_millis(20)),
        (Framing::Rtu, Duration::from_millis(16), Duration::from_millis(20)),
    ] {
        let outcome = torture(1, 1_000, framing, Size { late_reads, rests, ..Size::default() });
        let tell = format!("{framing}, reads late by {late_reads}, rests of {rests}: {outcome:?}");
        assert_eq!((outcome.unsolicited, outcome.collisions), (0, 0), "{tell}");
        assert!(outcome.ours > 400 && outcome.spoilt > 80, "{tell}");
        // Where the silence behind a corrupt frame cannot be seen, the next one is lost with it.
        let share =
            if framing == Framing::Rtu && late_reads + rests > punctual { outcome.ours / 10 } else { 0 };
        assert!(outcome.missed <= share, "{tell}");
    }
}
