//! Frames passed on while they arrive that pause or begin anew, as ASCII frames may; and under random faults, framings, speeds and
//! competition: no response is ever the wrong one.

use embassy_futures::join::join;
use mobgate_simulator::client::load::ClosedLoop;
use mobgate_simulator::timing::t1_5_ns;
use mobgate_simulator::wire::WireFrame;

use super::cut_through::{FRESH, PAIRS, SPEEDS, VALUE, between, counts, is_well, pairs, serial};
use crate::prelude::*;

const TO_ASCII: [(Framing, Framing); 2] = [PAIRS[1], PAIRS[3]];
const TRANSACTIONS: u32 = 150;
/// Worlds of a plain `cargo test`.
const WORLDS: u64 = 60;
/// Of all requests, corrupt ones included, in per cent.
const GOOD_MIN: f64 = 70.0;
/// On some boards.
const LATE_READS: Duration = Duration::from_micros(300);

/// The most that may pass between two characters of an ASCII frame (Serial Line 2.5.2.1).
const ASCII_PAUSE: Duration = Duration::from_secs(1);
/// How much longer than it may take the gateway a master waits for a response, which must have begun by then.
const GRACE: Duration = Duration::from_millis(100);

/// In a device's response. Shorter than any t3.5: nobody takes the rest for the beginning of something.
const PAUSE: Duration = Duration::from_micros(1_200);

/// These two lines on a host that reads late by `late_reads`, with device 5, which the master calls 105.
fn read_late(
    late_ms: u64,
    (up, up_baud): (Framing, u32),
    (down, down_baud): (Framing, u32),
    play: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>),
) {
    let settings = format!(
        "port S serial up {}\nport C serial down {} timeout 100ms\nroute S 101-109 * -100 C cut on\n",
        serial(up, "server", up_baud),
        serial(down, "client", down_baud)
    );
    let size = Size { late_reads: Duration::from_millis(late_ms), ..Size::default() };
    rig::with_gateway_of(size, 1, &settings, |world, rig| {
        rig.attach(world, "down", [Device::new(5)]);
        play(world, rig);
    });
}

#[test]
fn an_ascii_request_that_begins_anew_is_passed_on_only_from_its_new_beginning() {
    pairs(&PAIRS[2..], &SPEEDS, "", |case, _, world, rig, devices| {
        let frame = framing::frame(Framing::Ascii, 105, &READ);
        let mut master = rig.master("up");
        for length in 1..frame.len() {
            world.run_until(master.send_bytes(&frame[..length]));
            is_well(case, world, &mut master);
            world.run_for(Duration::from_millis(50));
        }
        assert_eq!(devices[0].counters().all_requests(), frame.len() as u64 - 1, "{case}");
    });
}

#[test]
fn a_frame_that_begins_anew_in_the_middle_of_a_read_is_not_mixed_with_the_one_before() {
    for down in [Framing::Rtu, Framing::Ascii] {
        read_late(3, (Framing::Ascii, 9_600), (down, 9_600), |world, rig| {
            let mut master = rig.master("up");
            let other = framing::frame(Framing::Ascii, 105, &[3, 0, 9, 0, 1]);
            for length in 1..other.len() {
                // At any moment before the next read.
                world.run_for(Duration::from_micros(50_000 + 190 * length as u64));
                let both = [&other[..length], &framing::frame(Framing::Ascii, 105, &READ)].concat();
                world.run_until(master.send_bytes(&both));
                let heard = world.run_until(master.receive()).expect("a response");
                let response = framing::open(Framing::Ascii, &heard.bytes);
                assert_eq!(response, Some((105, VALUE.to_vec())), "{down}, {length}");
            }
            assert!(counts(rig, "C")[2] > 0, "{down}: the ones before were begun");
        });
    }
}

#[test]
fn an_ascii_master_may_pause_inside_its_frames() {
    pairs(&PAIRS[2..], &SPEEDS, "", |case, _, world, rig, devices| {
        let frame = framing::frame(Framing::Ascii, 105, &READ);
        let mut master = rig.master("up");
        for at in 1..frame.len() {
            world.run_until(async {
                master.send_bytes(&frame[..at]).await;
                Timer::after_millis(300).await;
            });
            world.run_until(master.send_bytes(&frame[at..]));
            let heard = world.run_until(master.receive()).expect("a response");
            let response = framing::open(Framing::Ascii, &heard.bytes);
            assert_eq!(response, Some((105, VALUE.to_vec())), "{case}, pause at {at}");
        }
        assert_eq!(devices[0].counters().all_requests(), frame.len() as u64 - 1, "{case}");
        // Begun once; after that its pauses are known, and again when a frame had none.
        assert!(counts(rig, "C")[2] <= 1, "{case}: {:?}", counts(rig, "C"));
        let before = counts(rig, "C")[0];
        for _ in 0..2 {
            is_well(case, world, &mut master);
        }
        assert_eq!(counts(rig, "C")[0], before + 1, "{case}");
    });
}

#[test]
fn a_master_that_pauses_inside_its_frames_keeps_nobody_else_from_the_line() {
    for down in [Framing::Rtu, Framing::Ascii] {
        between((Framing::Ascii, 9_600), (down, 19_200), "", |world, rig, _| {
            let frame = framing::frame(Framing::Ascii, 105, &READ);
            let (mut master, mut client) = (rig.master("up"), rig.client(machine(1), 502));
            let slow = async {
                for character in frame.chunks(1) {
                    master.send_bytes(character).await;
                    Timer::after_millis(500).await;
                }
                master.receive().await.expect("a response")
            };
            let others = async {
                for _ in 0..20 {
                    Timer::after_millis(310).await;
                    let asked = Instant::now();
                    assert_eq!(client.request(6, &READ).await, Response::Pdu(vec![3, 2, 6, 7]));
                    assert!(asked.elapsed() < Duration::from_millis(100), "{down}: {:?}", asked.elapsed());
                }
            };
            let (heard, ()) = world.run_until(join(slow, others));
            assert_eq!(framing::open(Framing::Ascii, &heard.bytes), Some((105, VALUE.to_vec())));
        });
    }
}

#[test]
fn an_ascii_device_that_pauses_inside_its_responses_is_answered_for_all_but_once() {
    let pause = Faults::new(1).with(When::Always, Fault::GapInside(Duration::from_millis(50)));
    pairs(&TO_ASCII, &SPEEDS, "", |case, _, world, rig, devices| {
        devices[0].set_faults(pause.clone());
        let mut master = rig.master("up");
        world.run_until(master.request(105, &READ));
        world.run_for(Duration::from_millis(200));
        for _ in 0..5 {
            is_well(case, world, &mut master);
            world.run_for(Duration::from_millis(50));
        }
        assert_eq!(counts(rig, "S")[1], 5, "{case}: {:?}", counts(rig, "S"));
    });
}

#[test]
fn what_is_read_together_with_the_end_of_its_frame_is_passed_on_as_well() {
    for &(up, down) in &PAIRS[1..] {
        // More characters than LRC, carriage return and line feed.
        read_late(5, (up, 19_200), (down, 19_200), |world, rig| {
            let mut master = rig.master("up");
            for nth in 0..40 {
                world.run_for(Duration::from_micros(130 * nth));
                is_well(&format!("{up} to {down}, {nth}"), world, &mut master);
            }
            let (down_cut, up_cut) = (counts(rig, "C")[0], counts(rig, "S")[0]);
            assert!(down_cut + up_cut > 20, "{up} to {down}: {down_cut}, {up_cut}");
        });
    }
}

#[test]
fn a_response_that_pauses_where_ascii_may_pause_is_passed_on_to_its_end() {
    between((Framing::Ascii, 19_200), (Framing::Rtu, 9_600), "", |world, rig, devices| {
        let pause = Fault::GapInside(Duration::from_micros(2_500));
        devices[0].set_faults(Faults::new(1).with(When::Always, pause));
        is_well("", world, &mut rig.master("up"));
        assert_eq!(counts(rig, "S"), [1, 0, 0]);
    });
}

#[test]
fn a_response_that_pauses_is_heard_to_its_end_where_reads_are_late() {
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
                let response = world.run_until(master.request(5, &[3, 0, 7, 0, registers]));
                let is_good = matches!(response, Response::Pdu(pdu) if pdu[..2] == [3, 2 * registers]);
                // A longer pause ends what the board relays, and spoils an RTU frame.
                assert!(is_good || pause_us >= t1_5_us, "{down}, a pause of {pause_us} us");
                world.run_for(Duration::from_millis(20));
            }
            assert!(counts(rig, "S")[0] > 0);
            let end = (rig.end("down"), Framing::Rtu);
            let hasty = rig.wire("down").hasty_frames(end, late_reads, Duration::from_ticks(0));
            assert_eq!(hasty, [], "{down}: requests in a response that pauses");
        });
    }
}

/// What came of a world.
#[derive(Default)]
struct Outcome {
    good: u32,
    refused: u32,
    silent: u32,
    corrupt: u32,
}

/// One of the two lines.
#[derive(Debug, Clone, Copy)]
struct Line {
    framing: Framing,
    baud: u32,
}

impl Line {
    fn draw(random: &mut Random) -> Self {
        let framing = [Framing::Rtu, Framing::Ascii][random.index(2)];
        Self { framing, baud: [9_600, 19_200, 38_400, 115_200][random.index(4)] }
    }

    fn port(&self, side: &str) -> String {
        serial(self.framing, side, self.baud)
    }
}

/// Responses go astray in some worlds and are late without a bound in the others: a stray one is the late one of another for all that
/// anybody can tell.
fn faults(random: &mut Random) -> Faults {
    let late = if random.chance(0.25) { Fault::WrongUnit } else { Fault::draw_late(random) };
    let last = [Fault::NoiseAfter(3), Fault::GapInside(PAUSE), Fault::Exception(4)];
    let kinds =
        [&[late, Fault::Dead, Fault::Unheard][..], &Fault::CORRUPTING, &Fault::MISFITS, &last].concat();
    kinds.into_iter().fold(Faults::new(random.bits()), |faults, fault| faults.with(When::Chance(0.02), fault))
}

/// One transaction of a master that speaks `format`, with a request that is sometimes corrupt; an ASCII one may pause.
async fn transaction(
    (master, format): (&mut Master, Framing),
    random: &mut Random,
    case: &str,
    last: &mut [u32; 2],
    outcome: &mut Outcome,
) {
    Timer::after_micros(random.within(4_000..=40_000)).await;
    let unit = random.index(2);
    let asked_us = Instant::now().as_micros() as u32;
    let mut frame = framing::frame(format, 101 + unit as u8, &[3, 0, FRESH as u8, 0, Fresh::REGISTERS as u8]);
    let corruption = random.index(8) == 0;
    if corruption {
        let at = random.index(frame.len());
        frame[at] ^= 1 << random.index(8);
    }
    if format == Framing::Ascii && random.index(16) == 0 {
        let (begin, rest) = frame.split_at(random.index(frame.len()));
        master.send_bytes(begin).await;
        Timer::after_micros(random.within(0..=20_000)).await;
        master.send_bytes(rest).await;
    } else {
        master.send_bytes(&frame).await;
    }
    let response = master.receive().await.map(|heard| heard.bytes);
    let Some(response) = response else {
        outcome.silent += 1;
        return;
    };
    let opened = framing::open(format, &response);
    match opened.as_ref().map(|(from, pdu)| (*from, &pdu[..])) {
        None => outcome.corrupt += 1,
        Some((from, [0x83, _])) => {
            assert!(!corruption && from == 101 + unit as u8, "{case}: {response:02x?}");
            outcome.refused += 1;
        }
        // The first half of a CRC looks like a whole one behind every 256th frame that is broken off there: the master sees
        // that bytes are missing.
        Some((_, [3, count, values @ ..])) if usize::from(*count) != values.len() => outcome.corrupt += 1,
        Some((from, pdu)) => {
            assert!(!corruption, "{case}: a response to a corrupt request, {response:02x?}");
            assert_eq!(from, 101 + unit as u8, "{case}");
            let fresh = Fresh::from_response(pdu).unwrap_or_else(|| panic!("{case}: {response:02x?}"));
            let stale = fresh.at_us.wrapping_sub(asked_us) > u32::MAX / 2 || fresh.reads <= last[unit];
            assert!(!stale, "{case}: a response to an earlier request");
            last[unit] = fresh.reads;
            outcome.good += 1;
        }
    }
}

/// A world drawn from `seed`: how many of its frames were passed on while they arrived, and what came of them.
fn world(seed: u64) -> (u32, Outcome) {
    let mut random = Random::new(seed);
    let (up, down) = (Line::draw(&mut random), Line::draw(&mut random));
    let late_reads = if random.index(4) == 0 { LATE_READS } else { Duration::from_ticks(0) };
    let policy = ["", " readonly", " addresses 0-999"][random.index(3)];
    // An ASCII line may take a second to see that a response broke off.
    let answer_within = Duration::from_millis(if down.framing == Framing::Ascii { 3_400 } else { 400 });
    let settings = format!(
        "port S serial up {} answer-within {}ms\nport C serial down {} timeout 50ms down-after 0 retries 1\nport T tcp server 502\n\
         route S 101-102 * -100 C cut on{policy}\nroute T * * * C\n",
        up.port("server"),
        answer_within.as_millis(),
        down.port("client")
    );
    let case = format!("seed {seed}, {up:?} to {down:?}{policy}, reads late by {late_reads:?}");
    rig::with_gateway_of(Size { late_reads, ..Size::default() }, seed, &settings, |world, rig| {
        let faults = faults(&mut random);
        let devices = [1, 2].map(|unit| Device::new(unit).with_fresh(FRESH).with_faults(faults.clone()));
        rig.attach(world, "down", devices.clone());
        let mut master = rig.master("up").with_patience(answer_within + GRACE);
        if random.index(2) == 0 {
            let mut client = rig.client(machine(1), 502);
            world.spawn(async move {
                let load = ClosedLoop::until(Instant::MAX).thinking(Duration::from_millis(30));
                load.run(&mut client, || (1, vec![3, 0, 0, 0, 20]), |_, _, _| {}).await
            });
        }
        world.run_for(Duration::from_millis(100));
        let (mut outcome, mut last) = (Outcome::default(), [0; 2]);
        for _ in 0..TRANSACTIONS {
            let requester = (&mut master, up.framing);
            world.run_until(transaction(requester, &mut random, &case, &mut last, &mut outcome));
        }
        assert_eq!(rig.wire("up").collisions(), 0, "{case}");
        for device in devices {
            assert_eq!(device.counters().gap_inside, 0, "{case}: a copy with a gap");
        }
        // Pauses in a master's ASCII frames are in their copies as well, but none longer than t1.5. A device's pause is in the copy
        // of its response, whatever t1.5 is on a faster line, and an ASCII copy waits as long for what it does not know.
        let pause = if up.framing == Framing::Ascii { ASCII_PAUSE } else { PAUSE };
        for (wire, line, pause) in [("up", up, pause), ("down", down, Duration::from_ticks(0))] {
            let end = (rig.end(wire), line.framing);
            let hasty = rig.wire(wire).hasty_frames(end, LATE_READS, pause);
            let before =
                |frame: &WireFrame| frame.start_ns <= hasty.first().map_or(0, |hasty| hasty.start_ns);
            let frames: Vec<_> = rig.wire(wire).frames().into_iter().filter(before).collect();
            let last = &frames[frames.len().saturating_sub(4)..];
            assert_eq!(hasty, [], "{case}, wire {wire}, of the last of {last:?}");
        }
        (rig.counted("C", Event::Cut) + rig.counted("S", Event::Cut), outcome)
    })
}

#[test]
fn no_response_is_the_wrong_one_whatever_happens_to_frames_on_their_way() {
    let mut total = Outcome::default();
    let (mut passed, mut all) = (0, 0);
    each_world(WORLDS, "cut_torture_good", GOOD_MIN, |seed, share| {
        let (cut, outcome) = world(seed);
        all += TRANSACTIONS;
        passed += cut;
        share.add(outcome.good, TRANSACTIONS);
        total.refused += outcome.refused;
        total.silent += outcome.silent;
        total.corrupt += outcome.corrupt;
    });
    // One world may be a bad one.
    if all > 10 * TRANSACTIONS {
        assert!(passed > all / 2, "{passed} frames were passed on while they arrived");
        let kinds = [total.refused, total.silent, total.corrupt];
        assert!(kinds.iter().all(|count| *count > 0), "every kind of bad day was there: {kinds:?}");
    }
}
