//! Responses that get lost while process data go on: they come again, and neither they nor the outputs are taken for something else.

use mobgate_simulator::sub_device::sequence;

use crate::prelude::*;

/// Status and activation of the mailbox from the device, as SOEM writes them at once.
const STATUS: u16 = 0x080d;
/// Long enough for a processor with pauses to do all that there is.
const SLOW: Duration = Duration::from_millis(3);
const AT_ONCE: Duration = Duration::from_micros(0);

/// An upload of 1018h, and its response without header and counter.
fn request(sub: u8) -> [u8; 10] {
    [0, 0x20, 0x40, 0x18, 0x10, sub, 0, 0, 0, 0]
}

#[test]
fn a_repetition_that_is_asked_for_while_outputs_come_is_neither_lost_nor_hides_the_next_response() {
    for after_us in (0..200).step_by(2) {
        let (mut rig, _) = slow_device(after_us, 20, SLOW);
        rig.send(&request(1));
        rig.pause = AT_ONCE;
        let lost = rig.receive().unwrap();
        rig.pause = Duration::from_micros(after_us);
        rig.exchange(&image(2, 120));
        rig.pause = SLOW;
        rig.write(STATUS, &[0, 3]);
        assert_eq!(rig.read(STATUS + 2, 1).unwrap()[0] & 2, 2, "acknowledged");
        rig.send(&request(2));
        assert_eq!(rig.receive(), Some(lost), "asked for after {after_us} us");
        let next = rig.receive().unwrap_or_else(|| panic!("lost, asked for after {after_us} us"));
        assert_eq!(next[11], 2);
        assert_eq!(rig.receive(), None);
    }
}

#[test]
fn outputs_are_taken_though_a_repetition_is_asked_for_twice_in_the_same_words() {
    for after_us in (0..200).step_by(2) {
        let (mut rig, echo) = slow_device(after_us, 20, SLOW);
        rig.send(&request(1));
        let lost = rig.receive().unwrap();
        rig.write(STATUS, &[0, 3]);
        rig.pause = Duration::from_micros(after_us);
        rig.exchange(&image(2, 120));
        rig.pause = SLOW;
        // The response to the first writing was lost too.
        rig.write(STATUS, &[0, 3]);
        assert_eq!(echo.0.borrow().last, Some(2), "written again after {after_us} us");
        assert_eq!((echo.0.borrow().torn, rig.receive()), (0, Some(lost)));
    }
}

/// Whatever is lost, a MainDevice that repeats gets each response once, and the outputs that it sent last are those in force.
#[test]
fn with_lost_responses_and_repetitions_no_outputs_are_stale() {
    for seed in 0..14 {
        let (mut rig, echo) = slow_device(seed, 20, SLOW);
        let mut random = Random::new(seed);
        let mut repeat = false;
        for number in 2..300 {
            let sub = (number % 4 + 1) as u8;
            rig.pause = Duration::from_micros(random.within(0..=60));
            assert_eq!(rig.send(&request(sub)), 1, "seed {seed}, {number}");
            rig.exchange(&image(number, 120));
            while random.chance(0.5) {
                // It may have been fetched or not: this frame did not come back.
                rig.receive();
                repeat = !repeat;
                for _ in 0..=random.index(3) {
                    rig.write(STATUS, &[0, 1 | u8::from(repeat) << 1]);
                    rig.pause = Duration::from_micros(random.within(0..=60));
                }
                rig.pause = Duration::from_micros(50);
                let served = |rig: &mut Rig<_>| rig.read(STATUS + 2, 1).unwrap()[0] >> 1 & 1 == repeat.into();
                let waited = (0..200).take_while(|_| !served(&mut rig)).count();
                assert!(waited < 200, "seed {seed}, {number}: the repeat request is not acknowledged");
            }
            rig.pause = SLOW;
            rig.pass(6);
            assert_eq!(echo.0.borrow().last, Some(number), "seed {seed}: stale outputs");
            // The response, perhaps behind one that was had.
            let responses: Vec<u8> =
                std::iter::from_fn(|| rig.receive()).map(|response| response[11]).collect();
            assert!(responses.len() <= 2, "seed {seed}: {responses:?}");
            assert!(responses.last().is_none_or(|last| *last == sub), "seed {seed}: {responses:?} for {sub}");
        }
        assert_eq!(echo.0.borrow().torn, 0);
        let last = rig.exchange(&image(300, 120)).0;
        assert_eq!(sequence(&last), Some(299));
        assert_eq!(rig.status(), (OP, 0));
    }
}

#[test]
fn inputs_can_be_read_after_their_sync_manager_was_off_and_on_without_any_outputs() {
    for state in [SAFE_OP, OP] {
        let mut rig = Rig::in_state(&MAILBOX_128, state);
        let activation = Channel::Inputs.registers() + 6;
        assert_eq!(rig.segment.poke(0, activation, &[0]), 1);
        assert_eq!(rig.write(activation, &[1]), 1);
        assert_eq!(rig.status(), (state, 0), "too quick to be seen off");
        assert!(rig.read(MAILBOX_128.memory.start(Channel::Inputs), 120).is_some(), "in {state}");
    }
}
