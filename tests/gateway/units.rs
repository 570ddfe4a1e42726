//! The health of units: late-reply window, down, probes.

use embassy_time::{Duration, Instant};
use mobgate::config::{PORTS_MAX, PortId, Proof};
use mobgate::port::outstanding::Purpose;
use mobgate::port::queue::Ready;
use mobgate::port::units::{ALL_UNITS_MAX, AllUnits, Care, Gate, PROBE_LONGEST, Step, UNITS_MAX, Units};
use mobgate::stats::Event;

const WINDOW: Duration = Duration::from_secs(1);
const DOWN_AFTER: u8 = 3;

fn time_out(units: &mut Units, id: u8, now: Instant) {
    units.asked(id);
    units.timed_out(id, now, DOWN_AFTER);
}

#[test]
fn a_time_out_holds_up_nobody() {
    let (mut all, port) = (AllUnits::new(), PortId(0));
    let mut units = all.of(port);
    let now = Instant::from_secs(10);
    assert_eq!(units.gate(5, now), Gate::Open(Ready::Now));
    time_out(&mut units, 5, now);
    assert_eq!(units.gate(5, now), Gate::Open(Ready::Now));
    assert_eq!(units.gate(6, now), Gate::Open(Ready::Now));
}

#[test]
fn a_silent_unit_is_down_and_probed_at_growing_intervals() {
    let (mut all, port) = (AllUnits::new(), PortId(0));
    let mut units = all.of(port);
    let mut now = Instant::from_secs(0);
    for _ in 0..DOWN_AFTER {
        now += Duration::from_secs(2);
        time_out(&mut units, 5, now);
    }
    for pause in [1, 2, 4, 8, 16, 30, 30] {
        assert_eq!(units.gate(5, now), Gate::Down);
        let probe = now + Duration::from_secs(pause);
        assert_eq!(units.gate(5, probe - Duration::from_ticks(1)), Gate::Down);
        assert_eq!(units.gate(5, probe), Gate::Open(Ready::Now), "the probe after {pause} s");
        now = probe;
        time_out(&mut units, 5, now);
    }
    assert_eq!(PROBE_LONGEST, Duration::from_secs(30));
}

#[test]
fn one_answer_makes_a_unit_well_again() {
    for sign_of_life in [
        |units: &mut Units| units.answered(5, WINDOW, true),
        |units: &mut Units| units.damaged(5, Event::BadCheck),
    ] {
        let (mut all, port) = (AllUnits::new(), PortId(0));
        let mut units = all.of(port);
        for second in 0..10 {
            time_out(&mut units, 5, Instant::from_secs(second * 100));
        }
        sign_of_life(&mut units);
        let before_the_next_probe = Instant::from_secs(901);
        assert_eq!(units.gate(5, before_the_next_probe), Gate::Open(Ready::Now));
        let now = Instant::from_secs(2000);
        time_out(&mut units, 5, now);
        assert_eq!(units.gate(5, now), Gate::Open(Ready::Now), "not down");
    }
}

#[test]
fn a_unit_that_is_down_is_probed_soon_when_something_late_comes_and_again_when_it_has_answered_since() {
    let (mut all, port) = (AllUnits::new(), PortId(0));
    let mut units = all.of(port);
    let requests: [&[u8]; 3] = [&[3, 0, 0, 0, 1], &[4, 0, 0, 0, 1], &[1, 0, 0, 0, 1]];
    let answers: [&[u8]; 3] = [&[3, 2, 0, 7], &[4, 2, 0, 7], &[1, 1, 0]];
    for round in 1..=3 {
        let now = Instant::from_secs(100 * round);
        for request in requests {
            units.sent(5, request, Purpose::Request);
            time_out(&mut units, 5, now);
        }
        assert_eq!(units.gate(5, now), Gate::Down);
        let late = now + Duration::from_millis(10);
        assert_eq!(units.heard(5, answers[0], false, late), Err(Event::Late));
        let soon = late + Duration::from_millis(100);
        assert_eq!(units.gate(5, soon - Duration::from_ticks(1)), Gate::Down, "more may be on its way");
        assert_eq!(units.gate(5, soon), Gate::Open(Ready::Now), "round {round}");
        for answer in &answers[1..] {
            assert_eq!(units.heard(5, answer, false, soon), Err(Event::Late));
        }
        units.sent(5, requests[0], Purpose::Request);
        assert_eq!(units.heard(5, answers[0], true, soon), Ok(()));
        units.answered(5, Duration::from_millis(10), false);
        assert_eq!(units.gate(5, soon), Gate::Open(Ready::Now));
    }
}

#[test]
fn while_units_are_looked_for_silence_says_nothing() {
    let (mut all, port) = (AllUnits::new(), PortId(0));
    let mut units = all.of(port);
    units.freeze(true);
    units.asked(5);
    assert!(!units.timed_out(5, Instant::from_secs(1), DOWN_AFTER), "it is not counted");
    assert_eq!(units.iter().count(), 0);
}

#[test]
fn with_zero_a_unit_is_never_down() {
    let (mut all, port) = (AllUnits::new(), PortId(0));
    let mut units = all.of(port);
    for second in 0..100 {
        units.timed_out(5, Instant::from_secs(second), 0);
        assert_ne!(units.gate(5, Instant::from_secs(second)), Gate::Down);
    }
}

#[test]
fn when_there_are_more_units_than_places_the_ones_in_trouble_are_remembered() {
    let (mut all, port) = (AllUnits::new(), PortId(0));
    let mut units = all.of(port);
    for _ in 0..DOWN_AFTER {
        time_out(&mut units, 200, Instant::from_secs(1));
    }
    for id in 1..=100 {
        units.asked(id);
        units.answered(id, WINDOW, false);
    }
    assert_eq!(units.iter().count(), UNITS_MAX);
    assert_eq!(units.gate(200, Instant::from_secs(1)), Gate::Down);
}

#[test]
fn the_units_of_one_port_do_not_take_the_places_of_another() {
    let mut all = AllUnits::new();
    let now = Instant::from_secs(1);
    let few = PortId(PORTS_MAX as u8 - 1);
    for id in 1..=3 {
        time_out(&mut all.of(few), id, now);
    }
    for port in (0..few.0).map(PortId) {
        (1..=247).for_each(|id| all.of(port).asked(id));
    }
    let ids = |all: &mut AllUnits, port| all.of(port).iter().map(|unit| unit.id).collect::<Vec<_>>();
    assert_eq!(ids(&mut all, few), [1, 2, 3]);
    let all_units: usize = (0..PORTS_MAX).map(|port| all.of(PortId(port as u8)).iter().count()).sum();
    assert_eq!(all_units, ALL_UNITS_MAX);
    all.of(few).asked(4);
    assert_eq!(ids(&mut all, few), [1, 2, 3, 4]);
    all.of(few).clear();
    assert_eq!(ids(&mut all, few), []);
    all.of(few).asked(9);
    assert_eq!(ids(&mut all, few), [9]);
    assert!(all.of(PortId(0)).iter().all(|unit| unit.id > 200), "the newest ones are known, and no more");
}

#[test]
fn a_unit_ignores_function_8_when_many_proofs_in_a_row_are_lost_and_not_before() {
    const READ: [u8; 5] = [3, 0, 0, 0, 1];
    const OTHER: [u8; 5] = [4, 0, 0, 0, 1];
    let (mut all, port) = (AllUnits::new(), PortId(0));
    let mut units = all.of(port);
    let care = Care { proof: Proof::Auto, late_window: WINDOW };
    let now = Instant::from_secs(10);
    let mut proofs = 0;
    loop {
        units.sent(5, &READ, Purpose::Request);
        units.timed_out(5, now, 0);
        // A proof by a read goes in turn with one by function 8.
        let mut purpose = Purpose::Read;
        while purpose != Purpose::Diagnostic {
            let step = units.step(5, &READ, &care, now);
            let Step::Prove(request, by) = step else {
                assert_eq!(step, Step::Wait);
                assert_eq!(proofs, 8, "time is the last thing to rely on");
                return;
            };
            units.sent(5, &request, by);
            units.not_proved(5, now, 0);
            purpose = by;
        }
        proofs += 1;
        units.sent(5, &OTHER, Purpose::Request);
        assert_eq!(units.heard(5, &[4, 2, 0, 7], true, now), Ok(()));
    }
}
