//! What goes before a request to a unit that may still answer an earlier one.

use mobgate::gateway::unit_health::{Care, Gate, State, Step, Unit, Units};
use mobgate::settings::Proof;

use crate::prelude::*;
use crate::units::new_units;

const ID: u8 = 5;
const WINDOW: Duration = Duration::from_secs(2);
const TICK: Duration = Duration::from_ticks(1);
const NOW: Instant = Instant::from_secs(10);
const AFTERWARDS: Instant = Instant::from_secs(20);
const AUTO: Care = Care { proof: Proof::Auto, late_window: WINDOW };
const NONE: Care = Care { proof: Proof::None, late_window: WINDOW };

const ONE: [u8; 5] = [3, 0, 0, 0, 1];
/// As long as [`ONE`].
const OTHER: [u8; 5] = [3, 0, 9, 0, 1];
const TWO: [u8; 5] = [3, 0, 0, 0, 2];
const INPUT: [u8; 5] = [4, 0, 0, 0, 1];
const INPUTS: [u8; 5] = [4, 0, 0, 0, 2];
const COIL: [u8; 5] = [1, 0, 0, 0, 1];
const WRITE: [u8; 5] = [6, 0, 0, 0, 1];
const TO_INPUT: [u8; 4] = [4, 2, 0, 7];

/// Sent and not answered.
fn lost(units: &mut Units, request: &[u8]) {
    units.sent(ID, request, Purpose::Request);
    units.timed_out(ID, NOW, 0);
}

/// The proof that goes first: none by a read is one by function 8.
fn proof(units: &mut Units, request: &[u8], now: Instant) -> Option<[u8; 5]> {
    match units.step(ID, request, &AUTO, now) {
        Step::Prove([8, 0, 0, ..], Purpose::Diagnostic) => None,
        Step::Prove(read, Purpose::Read) => Some(read),
        other => panic!("{other:?}"),
    }
}

fn unit<'u>(units: &'u Units<'_>) -> &'u Unit {
    units.iter().find(|unit| unit.id == ID).expect("it is known")
}

/// A proof by function 8 that the unit ignores: it answers what came behind.
fn ignores(units: &mut Units) {
    units.sent(ID, &[8, 0, 0, 9, 9], Purpose::Diagnostic);
    units.sent(ID, &INPUT, Purpose::Request);
    assert_eq!(units.match_response(ID, &TO_INPUT, true, NOW), Ok(()));
}

/// A proof by function 8 that the unit responds to.
fn echoes(units: &mut Units) {
    units.sent(ID, &[8, 0, 0, 9, 9], Purpose::Diagnostic);
    assert_eq!(units.match_response(ID, &[8, 0, 0, 9, 9], true, NOW), Ok(()));
    units.proved(ID);
}

/// A response that nobody has asked for.
fn unsolicited(units: &mut Units, now: Instant) {
    assert_eq!(units.match_response(ID, &[3, 2, 0, 7], false, now), Err(Event::Unsolicited));
}

#[test]
fn the_read_in_turn_with_function_8_is_the_one_that_tells_most() {
    // Reads that it has answered, requests without a response, the next request, the read that goes first.
    type Case<'c> = (&'c [[u8; 5]], &'c [[u8; 5]], [u8; 5], Option<[u8; 5]>);
    let cases: &[Case] = &[
        // Nothing but the request itself is known; a write cannot be tried.
        (&[], &[ONE], ONE, Some(ONE)),
        (&[], &[WRITE], WRITE, None),
        // One whose response fits nothing that was sent before.
        (&[INPUT], &[ONE], ONE, Some(INPUT)),
        (&[ONE, INPUT], &[ONE], ONE, Some(INPUT)),
        (&[ONE, TWO], &[TWO], TWO, Some(ONE)),
        (&[INPUT], &[ONE], TWO, Some(INPUT)),
        (&[ONE], &[ONE], TWO, Some(TWO)),
        (&[TWO, INPUT], &[ONE, INPUT], ONE, Some(TWO)),
        // Else one that settles at least what was sent before it for the first time, and else any.
        (&[ONE, INPUT], &[ONE, INPUT], ONE, Some(INPUT)),
        (&[ONE, INPUT], &[ONE, INPUT], INPUT, Some(ONE)),
        (&[OTHER], &[ONE], ONE, Some(OTHER)),
        // Two of different shapes are remembered: the newest of each.
        (&[ONE, OTHER], &[ONE, WRITE], WRITE, Some(OTHER)),
        (&[ONE, INPUT, COIL], &[ONE, WRITE], WRITE, Some(COIL)),
        (&[ONE, INPUT, OTHER], &[ONE, INPUT, WRITE], WRITE, Some(OTHER)),
        (&[ONE, INPUT, INPUT], &[ONE, WRITE], WRITE, Some(INPUT)),
        (&[ONE, INPUT, ONE], &[ONE, WRITE], WRITE, Some(INPUT)),
        // Nothing but reads of functions 1 to 4 is one.
        (&[[5, 0, 0, 0, 1]], &[WRITE], WRITE, None),
    ];
    for (answered, before, request, read) in cases {
        let units = &mut new_units();
        before.iter().for_each(|request| lost(units, request));
        answered.iter().for_each(|read| units.learn(ID, read));
        assert_eq!(proof(units, request, NOW), None, "function 8 first: {answered:?} {before:?}");
        assert!(units.not_proved(ID, NOW, 0));
        assert_eq!(proof(units, request, NOW), *read, "{answered:?} {before:?} {request:?}");
        units.not_proved(ID, NOW, 0);
        assert_eq!(proof(units, request, NOW), None, "and in turn");
    }
}

#[test]
fn a_unit_that_answers_function_8_is_asked_by_nothing_else() {
    let units = &mut new_units();
    lost(units, &ONE);
    units.learn(ID, &INPUT);
    echoes(units);
    lost(units, &ONE);
    for _ in 0..4 {
        assert_eq!(proof(units, &ONE, NOW), None);
        units.not_proved(ID, NOW, 0);
    }
    // Many are lost before it counts as one that ignores it.
    for _ in 0..20 {
        ignores(units);
    }
    lost(units, &ONE);
    lost(units, &WRITE);
    assert_eq!(proof(units, &ONE, NOW), None, "20");
    ignores(units);
    lost(units, &ONE);
    lost(units, &WRITE);
    assert_eq!(proof(units, &ONE, NOW), Some(INPUT), "21");
}

#[test]
fn a_proof_that_is_answered_or_not_ends_what_was_noted_of_it() {
    // Whether it responds.
    for responses in [true, false] {
        let units = &mut new_units();
        units.sent(ID, &ONE, Purpose::Request);
        units.learn(ID, &INPUT);
        assert_eq!(units.state(unit(units), NOW), State::Up, "it is awaited");
        units.timed_out(ID, NOW, 0);
        assert_eq!(proof(units, &ONE, NOW), None);
        units.sent(ID, &[8, 0, 0, 9, 9], Purpose::Diagnostic);
        units.not_proved(ID, NOW, 0);
        assert_eq!(proof(units, &ONE, NOW), Some(INPUT));
        units.sent(ID, &INPUT, Purpose::Read);
        if responses {
            assert_eq!(units.match_response(ID, &TO_INPUT, true, NOW), Ok(()));
            units.proved(ID);
            assert_eq!(units.state(unit(units), NOW), State::Up);
            unsolicited(units, NOW);
            assert_eq!(units.state(unit(units), NOW), State::OutOfStep);
        } else {
            units.not_proved(ID, NOW, 0);
            units.match_response(ID, &[8, 0, 0, 9, 9], false, NOW).unwrap_err();
            let state = units.state(unit(units), NOW + WINDOW);
            assert_eq!(state, State::OutOfStep, "the read is outstanding");
        }
        lost(units, &ONE);
        assert_eq!(proof(units, &ONE, NOW), None, "function 8 first");
    }
}

#[test]
fn a_unit_is_out_of_step_when_something_unsolicited_came_and_nothing_is_awaited() {
    let responses: fn(&mut Units) = |units| {
        units.sent(ID, &ONE, Purpose::Request);
        units.match_response(ID, &[3, 2, 0, 7], true, NOW).unwrap();
        units.answered(ID, TICK, false);
    };
    for before in [responses, |units| units.error(ID, Event::Unsolicited)] {
        let units = &mut new_units();
        before(units);
        assert_eq!(units.state(unit(units), NOW), State::Up);
        unsolicited(units, NOW);
        assert_eq!(units.state(unit(units), NOW), State::OutOfStep);
    }
}

#[test]
fn a_unit_that_ignores_function_8_is_asked_by_a_read_that_settles_something() {
    let units = &mut new_units();
    for nth in 1..=8 {
        ignores(units);
        lost(units, &ONE);
        let step = units.step(ID, &ONE, &AUTO, NOW);
        assert_eq!(matches!(step, Step::Prove(_, Purpose::Diagnostic)), nth < 8, "{nth}");
    }
    let cases: &[(_, &[_], _)] = &[
        (INPUTS, &[ONE], Some(INPUTS)),
        (INPUT, &[ONE], Some(INPUT)),
        (COIL, &[COIL, ONE], Some(COIL)),
        (ONE, &[ONE], None),
    ];
    for (known, before, read) in cases {
        let units = &mut new_units();
        (0..8).for_each(|_| ignores(units));
        before.iter().for_each(|request| lost(units, request));
        units.learn(ID, known);
        match read {
            Some(_) => assert_eq!(proof(units, &ONE, NOW), *read),
            None => assert_eq!(units.step(ID, &ONE, &AUTO, NOW), Step::Wait, "it has no other shape"),
        }
    }
}

#[test]
fn function_8_is_tried_again_after_many_waits() {
    let units = &mut new_units();
    (0..8).for_each(|_| ignores(units));
    let mut now = NOW;
    let mut waits = 0;
    loop {
        lost(units, &ONE);
        if units.step(ID, &ONE, &AUTO, now) != Step::Wait {
            break;
        }
        waits += 1;
        assert!(waits <= 14);
        now += WINDOW;
        assert_eq!(units.step(ID, &ONE, &AUTO, now), Step::Direct);
    }
    assert_eq!(waits, 14);
    // And is found to be ignored at once.
    ignores(units);
    lost(units, &ONE);
    assert_eq!(units.step(ID, &ONE, &AUTO, now), Step::Wait);
    // So with one that has answered function 8 before, and does not any more.
    let units = &mut new_units();
    echoes(units);
    (0..21).for_each(|_| ignores(units));
    lost(units, &ONE);
    assert_eq!(units.step(ID, &ONE, &AUTO, NOW), Step::Wait);
    assert_eq!(units.step(ID, &ONE, &AUTO, NOW + WINDOW), Step::Direct);
    lost(units, &ONE);
    assert_eq!(proof(units, &ONE, NOW), None);
    ignores(units);
    lost(units, &ONE);
    assert_eq!(units.step(ID, &ONE, &AUTO, NOW), Step::Wait);
}

#[test]
fn a_unit_that_answered_no_proof_three_times_and_no_read_ever_is_waited_for() {
    for (known, waits) in [(false, true), (true, false)] {
        let units = &mut new_units();
        lost(units, &WRITE);
        if known {
            units.learn(ID, &INPUT);
        }
        for _ in 0..3 {
            assert!(matches!(units.step(ID, &WRITE, &AUTO, NOW), Step::Prove(..)));
            assert!(units.not_proved(ID, NOW, 200));
        }
        assert_eq!(units.step(ID, &WRITE, &AUTO, NOW) == Step::Wait, waits);
    }
}

#[test]
fn where_nothing_proves_anything_the_late_window_is_waited_for() {
    let units = &mut new_units();
    lost(units, &ONE);
    assert_eq!(units.state(unit(units), NOW), State::OutOfStep);
    assert_eq!(units.step(ID, &ONE, &NONE, NOW), Step::Wait);
    let end = NOW + WINDOW;
    assert_eq!(units.gate(ID, NOW), Gate::Open(Ready::At(end)));
    assert_eq!(units.attempt(ID, end - TICK), Ready::At(end));
    assert_eq!(units.attempt(ID, end), Ready::Now);
    assert_eq!(units.gate(ID, end), Gate::Open(Ready::Now));
    assert_eq!(units.state(unit(units), end - TICK), State::Held);
    assert_eq!(units.state(unit(units), end), State::OutOfStep);
    assert!(!units.all_healthy(end - TICK));
    assert_eq!(units.step(ID, &ONE, &NONE, end - TICK), Step::Wait, "it does not begin anew");
    assert!(!unit(units).unproven);
    assert_eq!(units.step(ID, &ONE, &NONE, end), Step::Direct);
    assert!(unit(units).unproven && units.is_in_step(ID, false));
    assert!(units.all_healthy(end));
    unsolicited(units, end);
    assert_eq!(units.step(ID, &ONE, &NONE, end), Step::Wait, "something else was to come");
    let end = end + WINDOW;
    assert_eq!(units.step(ID, &ONE, &NONE, end), Step::Direct);
    assert_eq!(units.state(unit(units), end), State::Up);
    // The next time it is waited for anew, also if it answers meanwhile something else.
    units.sent(ID, &ONE, Purpose::Request);
    units.timed_out(ID, end, 0);
    units.sent(ID, &WRITE, Purpose::Request);
    units.timed_out(ID, end, 0);
    assert_eq!(units.step(ID, &ONE, &NONE, end), Step::Wait);
    assert_eq!(units.match_response(ID, &[3, 2, 0, 7], false, end), Err(Event::Late));
    units.corrupt(ID, Event::BadCheck);
    assert_eq!(units.gate(ID, end), Gate::Open(Ready::At(end + WINDOW)));
    // When all that was sent is answered there is nothing left to be waited for.
    assert_eq!(units.match_response(ID, &WRITE, false, end + TICK), Err(Event::Late));
    assert_eq!(units.gate(ID, end + TICK), Gate::Open(Ready::Now));
    assert_eq!(units.step(ID, &ONE, &NONE, end + TICK), Step::Direct);
    unsolicited(units, end + TICK);
    assert_eq!(units.step(ID, &ONE, &NONE, end + TICK), Step::Wait, "but what came unsolicited");
    // What proves that it is in step takes the note away.
    assert!(unit(units).unproven);
    echoes(units);
    assert!(!unit(units).unproven);
}

#[test]
fn the_settings_say_what_proves_that_a_unit_is_in_step() {
    let read = Proof::Read { kind: Kind::Input, address: 0x0102, count: 0x0304 };
    let care = |proof| Care { proof, late_window: WINDOW };
    let units = &mut new_units();
    assert_eq!(units.step(ID, &ONE, &NONE, NOW), Step::Direct);
    assert!(units.all_healthy(NOW) && !units.needs_check());
    lost(units, &ONE);
    assert_eq!(units.step(ID, &INPUT, &NONE, NOW), Step::Direct, "another function");
    assert!(units.all_healthy(NOW) && !units.needs_check());
    let own = [4, 1, 2, 3, 4];
    assert_eq!(units.step(ID, &ONE, &care(read), NOW), Step::Prove(own, Purpose::Read));
    assert!(units.needs_check());
    // Nothing else is asked by.
    units.learn(ID, &INPUT);
    for _ in 0..3 {
        let step = units.step(ID, &ONE, &care(Proof::Diagnostic), NOW);
        assert!(matches!(step, Step::Prove([8, 0, 0, ..], Purpose::Diagnostic)));
        units.not_proved(ID, NOW, 0);
    }
    // It proves nothing any more when it has been sent in vain.
    lost(units, &own);
    assert_eq!(units.step(ID, &ONE, &care(read), NOW), Step::Wait);
    let units = &mut new_units();
    lost(units, &ONE);
    units.clear();
    units.clear();
    assert_eq!(units.iter().count(), 0);
    assert_eq!(proof(units, &ONE, NOW), None, "what it may still answer is known");
}

#[test]
fn pauses_between_proofs_grow() {
    let units = &mut new_units();
    let mut now = NOW;
    for pause in [100, 100, 200, 400, 800, 1600, 3200, 6400, 12_800, 12_800] {
        units.sent(ID, &[8, 0, 0, 1, 1], Purpose::Diagnostic);
        assert!(units.not_proved(ID, now, 200));
        assert!(units.needs_check() && !units.is_down(ID));
        now += Duration::from_millis(pause);
        assert_eq!(units.gate(ID, now - TICK), Gate::Open(Ready::At(now)), "{pause}");
        assert_eq!(units.gate(ID, now), Gate::Open(Ready::Now));
        assert_eq!(units.attempt(ID, now - TICK), Ready::Now);
    }
    units.proved(ID);
    units.sent(ID, &[8, 0, 0, 1, 1], Purpose::Diagnostic);
    units.not_proved(ID, now, 200);
    assert_eq!(unit(units).held_until, now + Duration::from_millis(100), "as at first");
    // It answers all but function 8, or sends only what nobody has asked for.
    for (responses, grows) in [(true, false), (false, true)] {
        let units = &mut new_units();
        units.sent_in_part(ID);
        for nth in 0..4 {
            units.sent(ID, &[8, 0, 0, 1, 1], Purpose::Diagnostic);
            assert!(units.not_proved(ID, NOW, 200));
            let pause = Duration::from_millis(if grows { 100.max(50 << nth) } else { 100 });
            assert_eq!(unit(units).held_until, NOW + pause, "{nth}");
            if responses {
                units.sent(ID, &INPUT, Purpose::Read);
            }
            assert_eq!(units.match_response(ID, &TO_INPUT, responses, NOW), Err(Event::Late));
        }
    }
    for (down_after, proofs) in [(0, None), (1, Some(1)), (3, Some(3))] {
        let units = &mut new_units();
        let down = (1..=10).find(|_| {
            units.sent(ID, &[8, 0, 0, 1, 1], Purpose::Diagnostic);
            units.not_proved(ID, NOW, down_after);
            units.is_down(ID)
        });
        assert_eq!(down, proofs);
        assert_eq!(units.gate(ID, NOW) == Gate::Open(Ready::Now), down_after == 0);
        if down.is_some() {
            assert_eq!(units.state(unit(units), NOW), State::Down);
        }
    }
}

#[test]
fn something_heard_instead_of_a_proofs_response_leaves_the_request_its_turn() {
    let units = &mut new_units();
    lost(units, &ONE);
    units.sent(ID, &[8, 0, 0, 1, 1], Purpose::Diagnostic);
    assert_eq!(units.match_response(ID, &[3, 2, 0, 7], false, NOW), Err(Event::Late));
    assert!(!units.not_proved(ID, NOW, 1));
    assert!(!units.is_down(ID));
    units.sent(ID, &[8, 0, 0, 1, 2], Purpose::Diagnostic);
    assert!(units.not_proved(ID, NOW, 1), "nothing since");
    assert!(units.is_down(ID));
}

#[test]
fn late_responses_hold_a_unit_for_a_moment_and_three_of_them_tell_that_it_is_slow() {
    for (took, pause) in [(10, 100), (50, 100), (51, 102), (400, 800)] {
        let units = &mut new_units();
        units.answered(ID, Duration::from_millis(took), false);
        for nth in 1..=4 {
            assert_eq!(unit(units).is_slow(), nth > 3);
            lost(units, &ONE);
            lost(units, &WRITE);
            let now = NOW + Duration::from_secs(nth);
            assert_eq!(units.match_response(ID, &[3, 2, 0, 7], false, now), Err(Event::Late));
            assert!(units.needs_check());
            let held = now + Duration::from_millis(pause);
            // One that is always late is not hurried any more.
            if nth <= 3 {
                assert_eq!(unit(units).held_until, held, "{took} {nth}");
            } else {
                assert!(unit(units).held_until < now);
            }
            assert_eq!(units.match_response(ID, &WRITE, true, now), Ok(()));
        }
        units.answered(ID, Duration::from_millis(took), false);
        assert!(!unit(units).is_slow());
        lost(units, &ONE);
        lost(units, &WRITE);
        units.match_response(ID, &[3, 2, 0, 7], false, AFTERWARDS).unwrap_err();
        let held = AFTERWARDS + Duration::from_millis(pause);
        assert_eq!(unit(units).held_until, held, "after a response in time it is hurried again");
        units.timed_out(ID, AFTERWARDS, 1);
        assert!(units.is_down(ID), "also while it is held");
    }
    let units = &mut new_units();
    for nth in 1..=3 {
        lost(units, &ONE);
        lost(units, &WRITE);
        units.match_response(ID, &[3, 2, 0, 7], false, NOW).unwrap_err();
        units.match_response(ID, &WRITE, true, NOW).unwrap();
        assert_eq!(unit(units).is_slow(), nth == 3, "it has never answered in time");
    }
    let units = &mut new_units();
    for nth in 0..5 {
        let kind = if nth == 0 { Event::Unsolicited } else { Event::Late };
        assert_eq!(units.match_response(ID, &[4, 2, 0, 7], nth % 2 == 0, NOW), Err(kind));
    }
    units.asked(ID);
    units.match_response(ID, &[4, 2, 0, 7], false, NOW).unwrap_err();
    assert!(!unit(units).is_slow(), "nobody has asked");
}

#[test]
fn while_units_are_looked_for_nothing_has_to_be_proved_and_it_is_unknown_afterwards() {
    let units = &mut new_units();
    lost(units, &ONE);
    units.freeze(true);
    assert!(units.is_in_step(ID, false));
    assert!(units.not_proved(ID, NOW, 0));
    assert_eq!(units.step(ID, &ONE, &AUTO, NOW), Step::Direct);
    units.sent(ID, &INPUT, Purpose::Request);
    assert_eq!(units.match_response(ID, &TO_INPUT, true, NOW), Ok(()));
    assert_eq!(units.match_response(ID, &TO_INPUT, false, NOW), Err(Event::Unsolicited));
    units.freeze(false);
    assert!(!units.is_in_step(ID, false));
    assert_eq!(units.step(ID, &INPUT, &AUTO, NOW), Step::Direct, "none of these was noted");
    for in_vain in [
        |units: &mut Units| _ = units.timed_out(ID, NOW, 0),
        |units: &mut Units| units.corrupt(ID, Event::BadCheck),
    ] {
        units.freeze(true);
        in_vain(units);
        units.freeze(false);
        assert_eq!(proof(units, &INPUT, NOW), None);
        echoes(units);
        assert!(units.is_in_step(ID, false));
    }
    units.sent_in_part(ID);
    assert!(!units.is_in_step(ID, true));
}
