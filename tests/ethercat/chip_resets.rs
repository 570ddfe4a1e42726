//! A controller chip that is reset under the device: seen at once in every state, and the device is there again at once.

use crate::prelude::*;

const SEEDS: u64 = 1_000;
/// From the reset until the application knows.
const SEEN_MS: u64 = 100;
/// From a MainDevice's first request until PreOp.
const BACK: Duration = Duration::from_secs(1);
const PAUSE: Duration = Duration::from_millis(2);

/// The ways of a processor to its chip.
const REACHED: [fn() -> Rig<Bench>; 2] = [
    || behind_spi(InterruptPin::High, Timing::USUAL).0,
    || Rig::reached_by(&MAILBOX_128, Bench::default(), PAUSE, direct),
];

/// The application of a device that was in `state` knows that its chip is gone.
fn seen(rig: &Rig<Bench>, state: u16, seed: u64) {
    let application = rig.application();
    assert!(!application.faults.is_empty(), "seed {seed}: nobody has seen it");
    assert!(state != OP || application.stops > 0, "seed {seed}: outputs are still driven");
}

/// What a MainDevice does that finds a device in another state than it left it.
fn back_to_pre_op(rig: &mut Rig<Bench>, seed: u64) -> Duration {
    let begin = Instant::now();
    loop {
        rig.write(0x0120, &(INIT | ERROR).to_le_bytes());
        if rig.status() == (INIT, 0) {
            rig.set_up_mailboxes();
            rig.write(0x0120, &PRE_OP.to_le_bytes());
            if rig.status() == (PRE_OP, 0) {
                break;
            }
        }
        assert!(begin.elapsed() < BACK, "seed {seed}: {:?} after {:?}", rig.status(), begin.elapsed());
    }
    let took = begin.elapsed();
    assert!(rig.upload(0x1000, 0).is_ok(), "seed {seed}: the mailbox works");
    took
}

/// Lets a device in `state` do what it does there for `cycles`.
fn live(rig: &mut Rig<Bench>, state: u16, cycles: usize) {
    for _ in 0..cycles {
        match state {
            INIT | PRE_OP => rig.pass(2),
            _ => drop(rig.cycle(1)),
        }
    }
}

#[test]
fn a_chip_that_is_reset_is_seen_in_every_state_and_started_anew() {
    let mut longest = Duration::MIN;
    each_seed(SEEDS, |seed| {
        let mut random = Random::new(seed);
        let state = [INIT, PRE_OP, SAFE_OP, OP][random.index(4)];
        let interrupt = [InterruptPin::High, InterruptPin::Low, InterruptPin::OpenDrain][random.index(3)];
        // Some chips are ready late.
        let ready_nanos = random.within(1_000_000..=400_000_000);
        let (mut rig, chip) = behind_spi(interrupt, Timing { ready_nanos: 20_000_000, ..Timing::USUAL });
        rig.bring_to(state);
        live(&mut rig, state, random.index(10));
        rig.world.run_for(Duration::from_micros(random.within(0..=60_000)));
        chip.set_timing(Timing { ready_nanos, ..Timing::USUAL });
        chip.reset();
        rig.pass(SEEN_MS);
        seen(&rig, state, seed);
        longest = longest.max(back_to_pre_op(&mut rig, seed));
        let failures = rig.application().faults.len();
        assert!((1..=3).contains(&failures), "seed {seed}: {failures} failures told of one");
    });
    at_most("chip_reset_back_in_pre_op", longest.as_millis(), "ms", BACK.as_millis());
}

#[test]
fn a_reset_by_the_main_device_that_leaves_the_spi_as_it_was_is_seen_too() {
    for state in [INIT, PRE_OP, SAFE_OP, OP] {
        for reached in REACHED {
            let mut rig = reached();
            rig.bring_to(state);
            for byte in b"RES" {
                assert_eq!(rig.segment.poke(0, 0x0040, &[*byte]), 1);
            }
            // Requests that the chip does not tell of any more must not pass for a proof that it does.
            let begin = Instant::now();
            while begin.elapsed() < Duration::from_millis(SEEN_MS) {
                rig.write(0x0120, &PRE_OP.to_le_bytes());
            }
            seen(&rig, state, state.into());
            back_to_pre_op(&mut rig, state.into());
        }
    }
}

#[test]
fn an_idle_device_does_not_let_the_watchdog_of_its_side_run_out() {
    for state in [INIT, PRE_OP, SAFE_OP] {
        for reached in REACHED {
            let mut rig = reached();
            rig.bring_to(state);
            rig.pass(5_000);
            assert_eq!(rig.read(0x0443, 1).unwrap(), [0], "in {state}: how often it has run out");
            assert_eq!(rig.read(0x0110, 1).unwrap()[0] & 2, 2, "in {state}: its status");
        }
    }
}
