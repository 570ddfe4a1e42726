//! Frames passed on while they arrive, under random faults, speeds and competition: no answer is ever the wrong one.

use embassy_time::{Duration, Instant, Timer};
use mobgate::stats::Event;
use mobgate_simulator::client::load::ClosedLoop;
use mobgate_simulator::device::{Fresh, rtu};
use mobgate_simulator::fault::When;
use mobgate_simulator::rig::{Size, machine};
use mobgate_simulator::{Device, Fault, Faults, Master, Random, rig};

/// Registers that differ at every read.
const FRESH: u8 = 100;
const TRANSACTIONS: u32 = 150;

/// What came of a world.
#[derive(Default)]
struct Outcome {
    good: u32,
    refused: u32,
    silent: u32,
    damaged: u32,
}

fn faults(seed: u64) -> Faults {
    let late = Fault::Late(Duration::from_millis(1), Duration::from_millis(60));
    let kinds = [
        late,
        Fault::Dead,
        Fault::BadCrc,
        Fault::FlippedBit,
        Fault::LostByte,
        Fault::Truncated,
        Fault::WrongUnit,
        Fault::WrongFunction,
        Fault::WrongLength,
        Fault::NoiseAfter(3),
        Fault::Exception(4),
    ];
    kinds.into_iter().fold(Faults::new(seed), |faults, fault| faults.with(When::Chance(0.02), fault))
}

/// One transaction of the master, with a request that is sometimes damaged.
async fn transaction(
    master: &mut Master,
    random: &mut Random,
    case: &str,
    last: &mut [u32; 2],
    outcome: &mut Outcome,
) {
    Timer::after_micros(random.within(4_000..=40_000)).await;
    let unit = random.index(2);
    let asked_us = Instant::now().as_micros() as u32;
    let mut frame = rtu::frame(101 + unit as u8, &[3, 0, FRESH, 0, Fresh::REGISTERS as u8]);
    let damage = random.index(8) == 0;
    if damage {
        let at = random.index(frame.len());
        frame[at] ^= 1 << random.index(8);
    }
    master.send_bytes(&frame).await;
    let answer = master.receive().await.map(|heard| heard.bytes);
    let Some(answer) = answer else {
        outcome.silent += 1;
        return;
    };
    match rtu::open(&answer) {
        None => outcome.damaged += 1,
        Some((from, [0x83, _])) => {
            assert!(!damage && from == 101 + unit as u8, "{case}: {answer:02x?}");
            outcome.refused += 1;
        }
        Some((from, pdu)) => {
            assert!(!damage, "{case}: an answer to a damaged request, {answer:02x?}");
            assert_eq!(from, 101 + unit as u8, "{case}");
            let fresh = Fresh::from_answer(pdu).unwrap_or_else(|| panic!("{case}: {answer:02x?}"));
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
    let bauds = [9_600_u32, 19_200, 38_400, 115_200];
    let (up, down) = (bauds[random.index(4)], bauds[random.index(4)]);
    let late_reads = if random.index(4) == 0 { Duration::from_micros(300) } else { Duration::from_ticks(0) };
    let policy = ["", " readonly", " addresses 0-999"][random.index(3)];
    let settings = format!(
        "port S serial up rtu server {up} 8E1\n\
         port C serial down rtu client {down} 8E1 timeout 50ms down-after 0 retries 1\nport T tcp server 502\n\
         route S 101-102 * -100 C cut on{policy}\nroute T * * * C\n"
    );
    let case = format!("seed {seed}, {up} to {down}{policy}, reads late by {late_reads:?}");
    rig::with_gateway_of(Size { late_reads, ..Size::default() }, seed, &settings, |world, rig| {
        let devices =
            [1, 2].map(|unit| Device::new(unit).with_fresh(u16::from(FRESH)).with_faults(faults(seed)));
        rig.attach(world, "down", devices.clone());
        let mut master = rig.master("up").with_patience(Duration::from_millis(400));
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
            world.run_until(transaction(&mut master, &mut random, &case, &mut last, &mut outcome));
        }
        assert_eq!(rig.wire("up").collisions(), 0, "{case}");
        for device in devices {
            assert_eq!(device.counters().gap_inside, 0, "{case}: a copy with a gap");
        }
        let gap = rig.sent("down").shortest_gap_ns.unwrap_or(u64::MAX);
        let t3_5 = if down > 19_200 { 1_750_000 } else { 38_500_000_000 / u64::from(down) };
        assert!(gap >= t3_5, "{case}: {gap} ns of silence");
        (rig.counted("C", Event::Cut) + rig.counted("S", Event::Cut), outcome)
    })
}

#[test]
fn no_answer_is_the_wrong_one_whatever_happens_to_frames_on_their_way() {
    let mut total = Outcome::default();
    let mut passed = 0;
    for seed in 0..60 {
        let (cut, outcome) = world(seed);
        passed += cut;
        total.good += outcome.good;
        total.refused += outcome.refused;
        total.silent += outcome.silent;
        total.damaged += outcome.damaged;
    }
    let all = 60 * TRANSACTIONS;
    assert!(passed > all / 2, "{passed} frames were passed on while they arrived");
    assert!(total.good > all / 2, "{} good answers", total.good);
    assert!(total.refused > 0 && total.silent > 0 && total.damaged > 0, "every kind of bad day was there");
}
