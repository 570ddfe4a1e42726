//! Frames passed on while they arrive, under random faults, framings, speeds and competition: no response is ever the wrong one.

use mobgate_simulator::client::load::ClosedLoop;
use mobgate_simulator::wire::WireFrame;

use crate::cut_through::serial;
use crate::prelude::*;

/// Registers that differ at every read.
const FRESH: u8 = 100;
const TRANSACTIONS: u32 = 150;
/// Worlds of a plain `cargo test`.
const WORLDS: u64 = 60;
/// Of all requests, damaged ones included, in per cent.
const GOOD_MIN: f64 = 70.0;
/// On some boards.
const LATE_READS: Duration = Duration::from_micros(300);

/// The most that may pass between two characters of an ASCII frame (Serial Line 2.5.2.1).
const ASCII_PAUSE: Duration = Duration::from_secs(1);
/// How much longer than it may take the gateway a master waits for a response, which must have begun by then.
const GRACE: Duration = Duration::from_millis(100);

/// In a device's response. Shorter than any t3.5: nobody takes the rest for the beginning of something.
const PAUSE: Duration = Duration::from_micros(1_200);

/// What came of a world.
#[derive(Default)]
struct Outcome {
    good: u32,
    refused: u32,
    silent: u32,
    damaged: u32,
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

/// Answers go astray in some worlds and are late without a bound in the others: a stray one is the late one of another for all that
/// anybody can tell.
fn faults(random: &mut Random) -> Faults {
    let late = if random.chance(0.25) { Fault::WrongUnit } else { Fault::draw_late(random) };
    let last = [Fault::NoiseAfter(3), Fault::GapInside(PAUSE), Fault::Exception(4)];
    let kinds = [&[late, Fault::Dead, Fault::Unheard][..], &Fault::DAMAGED, &Fault::MISFITS, &last].concat();
    kinds.into_iter().fold(Faults::new(random.bits()), |faults, fault| faults.with(When::Chance(0.02), fault))
}

/// One transaction of a master that speaks `format`, with a request that is sometimes damaged; an ASCII one may pause.
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
    let mut frame = framing::frame(format, 101 + unit as u8, &[3, 0, FRESH, 0, Fresh::REGISTERS as u8]);
    let damage = random.index(8) == 0;
    if damage {
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
    let answer = master.receive().await.map(|heard| heard.bytes);
    let Some(answer) = answer else {
        outcome.silent += 1;
        return;
    };
    let opened = framing::open(format, &answer);
    match opened.as_ref().map(|(from, pdu)| (*from, &pdu[..])) {
        None => outcome.damaged += 1,
        Some((from, [0x83, _])) => {
            assert!(!damage && from == 101 + unit as u8, "{case}: {answer:02x?}");
            outcome.refused += 1;
        }
        // The first half of a CRC looks like a whole one behind every 256th frame that is broken off there: the master sees
        // that bytes are missing.
        Some((_, [3, count, values @ ..])) if usize::from(*count) != values.len() => outcome.damaged += 1,
        Some((from, pdu)) => {
            assert!(!damage, "{case}: an answer to a damaged request, {answer:02x?}");
            assert_eq!(from, 101 + unit as u8, "{case}");
            let fresh = Fresh::from_response(pdu).unwrap_or_else(|| panic!("{case}: {answer:02x?}"));
            let stale = fresh.at_us.wrapping_sub(asked_us) > u32::MAX / 2 || fresh.reads <= last[unit];
            assert!(!stale, "{case}: an answer to an earlier request");
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
        let devices =
            [1, 2].map(|unit| Device::new(unit).with_fresh(u16::from(FRESH)).with_faults(faults.clone()));
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
fn no_answer_is_the_wrong_one_whatever_happens_to_frames_on_their_way() {
    let mut total = Outcome::default();
    let (mut passed, mut all) = (0, 0);
    each_world(WORLDS, "cut_torture_good", GOOD_MIN, |seed, share| {
        let (cut, outcome) = world(seed);
        all += TRANSACTIONS;
        passed += cut;
        share.add(outcome.good, TRANSACTIONS);
        total.refused += outcome.refused;
        total.silent += outcome.silent;
        total.damaged += outcome.damaged;
    });
    // One world may be a bad one.
    if all > 10 * TRANSACTIONS {
        assert!(passed > all / 2, "{passed} frames were passed on while they arrived");
        let kinds = [total.refused, total.silent, total.damaged];
        assert!(kinds.iter().all(|count| *count > 0), "every kind of bad day was there: {kinds:?}");
    }
}
