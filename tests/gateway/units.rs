//! The health of units: late-reply window, down, probes.

use mobgate::gateway::unit_health::{
    ALL_UNITS_MAX, AllUnits, Care, Gate, PROBE_LONGEST, Step, UNITS_MAX, Units,
};
use mobgate::settings::{PORTS_MAX, Proof};

use crate::prelude::*;

const WINDOW: Duration = Duration::from_secs(1);
const DOWN_AFTER: u8 = 3;

/// Those of a port.
pub(crate) fn new_units() -> Units<'static> {
    Box::leak(Box::new(AllUnits::new())).of(PortId(3))
}

fn time_out(units: &mut Units, id: u8, now: Instant) {
    units.asked(id);
    units.timed_out(id, now, DOWN_AFTER);
}

#[test]
fn a_time_out_holds_up_nobody() {
    let mut units = new_units();
    let now = Instant::from_secs(10);
    assert_eq!(units.gate(5, now), Gate::Open(Ready::Now));
    time_out(&mut units, 5, now);
    assert_eq!(units.gate(5, now), Gate::Open(Ready::Now));
    assert_eq!(units.gate(6, now), Gate::Open(Ready::Now));
}

#[test]
fn a_silent_unit_is_down_and_probed_at_growing_intervals() {
    let mut units = new_units();
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
fn one_response_makes_a_unit_well_again() {
    for sign_of_life in [
        |units: &mut Units| units.answered(5, WINDOW, true),
        |units: &mut Units| units.corrupt(5, Event::BadCheck),
    ] {
        let mut units = new_units();
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
    let mut units = new_units();
    let requests: [&[u8]; 3] = [&[3, 0, 0, 0, 1], &[4, 0, 0, 0, 1], &[1, 0, 0, 0, 1]];
    let responses: [&[u8]; 3] = [&[3, 2, 0, 7], &[4, 2, 0, 7], &[1, 1, 0]];
    for round in 1..=3 {
        let now = Instant::from_secs(100 * round);
        for request in requests {
            units.sent(5, request, Purpose::Request);
            time_out(&mut units, 5, now);
        }
        assert_eq!(units.gate(5, now), Gate::Down);
        let late = now + Duration::from_millis(10);
        assert_eq!(units.match_response(5, responses[0], false, late), Err(Event::Late));
        let soon = late + Duration::from_millis(100);
        assert_eq!(units.gate(5, soon - Duration::from_ticks(1)), Gate::Down, "more may be on its way");
        assert_eq!(units.gate(5, soon), Gate::Open(Ready::Now), "round {round}");
        for response in &responses[1..] {
            assert_eq!(units.match_response(5, response, false, soon), Err(Event::Late));
        }
        units.sent(5, requests[0], Purpose::Request);
        assert_eq!(units.match_response(5, responses[0], true, soon), Ok(()));
        units.answered(5, Duration::from_millis(10), false);
        assert_eq!(units.gate(5, soon), Gate::Open(Ready::Now));
    }
}

#[test]
fn while_units_are_looked_for_silence_says_nothing() {
    let mut units = new_units();
    units.freeze(true);
    units.asked(5);
    assert!(!units.timed_out(5, Instant::from_secs(1), DOWN_AFTER), "it is not counted");
    assert_eq!(units.iter().count(), 0);
}

#[test]
fn with_zero_a_unit_is_never_down() {
    let mut units = new_units();
    for second in 0..100 {
        units.timed_out(5, Instant::from_secs(second), 0);
        assert_ne!(units.gate(5, Instant::from_secs(second)), Gate::Down);
    }
}

#[test]
fn it_is_counted_how_a_unit_does() {
    let mut units = new_units();
    let now = Instant::from_secs(1);
    units.timed_out(6, now, 0);
    let silent = units.iter().next().map(|unit| unit.error(Event::Silent));
    assert_eq!(silent, Some(1), "of one that was not known");
    units.clear();
    (0..7).for_each(|_| units.asked(5));
    units.answered(5, Duration::from_millis(3), true);
    units.answered(5, Duration::from_millis(4), false);
    let usual = units.iter().next().and_then(|unit| unit.times.percentile(50)).unwrap();
    assert!((2_000..8_000).contains(&usual), "{usual}");
    assert!(units.timed_out(5, now, DOWN_AFTER), "nothing was heard");
    units.asked(5);
    units.error(5, Event::Noise);
    assert!(!units.timed_out(5, now, DOWN_AFTER), "something was heard");
    assert!(!units.timed_out(5, now, DOWN_AFTER));
    units.error(5, Event::Response);
    let counted = |units: &Units| {
        let unit = units.iter().find(|unit| unit.id == 5).unwrap();
        let errors: Vec<_> = unit.errors().collect();
        ([unit.requests, unit.responses, unit.exceptions, unit.timeouts, unit.took_us], unit.silent, errors)
    };
    let errors = vec![(Event::Silent, 1), (Event::Noise, 1)];
    assert_eq!(counted(&units), ([8, 2, 1, 3, 4000], 3, errors));
    let unit = units.iter().next().unwrap();
    assert_eq!([Event::Silent, Event::Noise, Event::Late].map(|error| unit.error(error)), [1, 1, 0]);
    assert!(units.is_down(5));
    units.clear_counters();
    assert_eq!(counted(&units), ([0; 5], 3, vec![]));
    assert!(units.is_down(5), "its health stays");
    (0..70_000).for_each(|_| units.error(5, Event::Late));
    assert_eq!(units.iter().next().unwrap().error(Event::Late), u16::MAX);
}

#[test]
fn a_unit_is_down_after_just_so_many_time_outs_in_a_row() {
    for down_after in 1..=4 {
        let mut units = new_units();
        let now = Instant::from_secs(1);
        for nth in 1..=down_after {
            assert!(!units.is_down(5));
            units.asked(5);
            units.timed_out(5, now, down_after);
            assert_eq!(units.is_down(5), nth == down_after);
        }
        // Those that were sent before it was down do not put the next probe off.
        let probe = now + Duration::from_secs(1);
        units.timed_out(5, now, down_after);
        units.timed_out(5, probe - Duration::from_ticks(1), down_after);
        assert_eq!(units.gate(5, probe), Gate::Open(Ready::Now));
        assert!(units.needs_check() && !units.all_healthy(probe), "it still counts as down");
        units.answered(5, WINDOW, false);
        assert!(units.all_healthy(probe) && !units.needs_check());
    }
}

#[test]
fn a_unit_that_gave_a_joined_read_no_response_is_asked_for_less_at_a_time_for_a_minute() {
    let now = Instant::from_secs(1);
    let minute = Duration::from_secs(60);
    for error in [
        |units: &mut Units, now| units.refused_combined(5, now),
        |units: &mut Units, now| _ = units.timed_out(5, now, DOWN_AFTER),
    ] {
        let mut units = new_units();
        assert!(units.combines(5, now));
        units.asked(5);
        assert!(units.combines(5, now));
        error(&mut units, now);
        assert!(!units.combines(5, now + minute - Duration::from_ticks(1)));
        assert!(units.combines(5, now + minute));
        assert!(units.combines(6, now));
    }
}

#[test]
fn the_quietest_healthy_unit_makes_room() {
    let now = Instant::from_secs(1);
    let cases: [(&[u8], u8); 3] = [(&[], 10), (&[10], 11), (&[10, 11], 12)];
    for (held, forgotten) in cases {
        let mut units = new_units();
        for id in 1..=UNITS_MAX as u8 {
            units.asked(id);
            // The rest is down.
            if !(10..=12).contains(&id) {
                (0..DOWN_AFTER).for_each(|_| time_out(&mut units, id, now));
            }
        }
        (10..=12).for_each(|id| (0..id).for_each(|_| units.asked(id)));
        held.iter().for_each(|id| _ = units.not_proved(*id, now, DOWN_AFTER));
        units.asked(200);
        assert!(units.iter().all(|unit| unit.id != forgotten), "{forgotten}");
        assert_eq!(units.iter().count(), UNITS_MAX);
        assert_eq!(units.iter().last().map(|unit| unit.id), Some(200));
    }
}

#[test]
fn when_there_are_more_units_than_places_the_ones_with_errors_are_remembered() {
    let mut units = new_units();
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
    assert!(ids(&mut all, few).is_empty());
    all.of(few).asked(9);
    assert_eq!(ids(&mut all, few), [9]);
    assert!(all.of(PortId(0)).iter().all(|unit| unit.id > 200), "the newest ones are known, and no more");
}

#[test]
fn a_unit_ignores_function_8_when_many_proofs_in_a_row_are_lost_and_not_before() {
    const READ: [u8; 5] = [3, 0, 0, 0, 1];
    const OTHER: [u8; 5] = [4, 0, 0, 0, 1];
    let mut units = new_units();
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
        assert_eq!(units.match_response(5, &[4, 2, 0, 7], true, now), Ok(()));
    }
}
