//! Conformance: process data (statements 42 to 45 and 48).

use std::ops::RangeInclusive;

use mobgate_simulator::sub_device::{Echo, sequence};

use crate::prelude::*;

/// Images in statement 42; `cargo xtask bench ethercat` exchanges ten times as many.
const IMAGES: u64 = 10_000;
/// Enough for a processor that works in pieces to respond.
const SLOW: Duration = Duration::from_millis(3);

/// Exchanges images at cycles drawn from `cycle_us`; how the application fared.
fn exchange(images: u64, cycle_us: RangeInclusive<u64>, pause_us: u64) -> Echo {
    let (mut rig, echo) = slow_device(pause_us, pause_us, SLOW);
    let mut random = Random::new(images);
    let mut last = 0;
    for number in 2..images + 2 {
        rig.pause = Duration::from_micros(random.within(cycle_us.clone()));
        let (inputs, counter) = rig.exchange(&image(number, 120));
        assert_eq!(counter, 3);
        let back = sequence(&inputs).expect("inputs are never torn");
        assert!(back >= last && back < number, "{back} after {last}");
        last = back;
    }
    rig.pass(50);
    echo.0.take()
}

#[test]
fn statement_42_images_are_whole_and_none_is_lost() {
    let echo = exchange(IMAGES, 400..=1_000, 20);
    assert_eq!((echo.torn, echo.lost, echo.old, echo.again), (0, 0, 0, 0));
    assert_eq!(echo.last, Some(IMAGES + 1));
}

#[test]
fn statement_42_images_that_come_too_fast_are_left_out_but_never_torn() {
    let echo = exchange(IMAGES, 10..=100, 40);
    assert_eq!((echo.torn, echo.old, echo.last), (0, 0, Some(IMAGES + 1)));
    assert!(echo.lost > 1_000, "{echo:?}");
}

#[test]
fn statement_42_outputs_are_not_taken_that_were_read_while_their_sync_manager_was_switched_off() {
    let mut thrown_away = 0;
    for after_us in (0..200).step_by(4) {
        let (mut rig, echo) = slow_device(20, 20, SLOW);
        rig.pause = Duration::from_micros(after_us);
        rig.exchange(&image(2, 120));
        rig.pause = Duration::from_micros(0);
        rig.write(Channel::Outputs.registers() + 6, &[0]);
        // Into memory that nobody guards any more.
        rig.exchange(&image(3, 120));
        rig.pass(10);
        assert_eq!(rig.status(), (PRE_OP | ERROR, 0x001d));
        assert_eq!(echo.0.borrow().torn, 0, "switched off after {after_us} us");
        thrown_away += u64::from(echo.0.borrow().last == Some(1));
    }
    assert!(thrown_away > 5, "it was switched off while outputs were read");
}

#[test]
fn statement_43_stale_inputs_can_be_told_by_a_counter() {
    let mut rig = gateway_in(PRE_OP);
    rig.download_complete(0x1c13, 0, &[2, 0, 0x00, 0x1a, 0x02, 0x1a]).unwrap();
    rig.set_up_process_data();
    // One byte more than after power-on.
    set_anew(&mut rig, Channel::Inputs, |block| block[2] += 1);
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    let mut counters = (0..5).map(|_| rig.read(GATEWAY.memory.start(Channel::Inputs), 121).unwrap()[120]);
    assert!(counters.by_ref().zip(1..).all(|(counter, expected)| counter == expected));

    // The processor stops: inputs stay readable, and their counter stays what it was.
    let Rig { mut segment, world, .. } = rig;
    drop(world);
    let _world = mobgate_simulator::World::new(1);
    let mut read = || segment.fetch(0, GATEWAY.memory.start(Channel::Inputs), 121).map(|inputs| inputs[120]);
    assert_eq!([read(), read(), read()], [Some(6); 3]);
}

#[test]
fn statement_44_only_complete_outputs_feed_the_watchdog() {
    let mut rig = Rig::in_state(&MAILBOX_128, OP);
    let read_only = |rig: &mut Rig<_>| {
        for _ in 0..20 {
            rig.pass(10);
            assert_eq!(rig.segment.send_logical(Command::Lrd, LOGICAL + 120, &[0; 120]).counter, 1);
        }
    };
    read_only(&mut rig);
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x001b));
    rig.cycle(1);
    assert_eq!(rig.request(OP | ERROR), (OP, 0));
    for _ in 0..20 {
        rig.pass(10);
        assert_eq!(rig.segment.send_logical(Command::Lwr, LOGICAL, &[7; 119]).counter, 1);
    }
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x001b), "all but the last byte");
    assert_ne!(rig.application().outputs, [7; 120]);
}

/// Cycles with messages between them: no message is lost, no image torn, and Op stays.
fn cycles_with_messages(cycle_us: RangeInclusive<u64>) {
    let (mut rig, echo) = slow_device(5, 5, SLOW);
    let mut random = Random::new(1);
    let request = |sub| [0, 0x20, 0x40, 0x18, 0x10, sub, 0, 0, 0, 0];
    let (mut sent, mut answered) = (0u8, 0u8);
    for number in 2..3_000 {
        rig.pause = Duration::from_micros(random.within(cycle_us.clone()));
        rig.exchange(&image(number, 120));
        rig.pause = Duration::from_micros(0);
        if random.chance(0.3) && rig.send(&request(sent % 4 + 1)) == 1 {
            sent = sent.wrapping_add(1);
        }
        if let Some(response) = rig.receive() {
            assert_eq!(response[11], answered % 4 + 1, "responses in order");
            answered = answered.wrapping_add(1);
        }
    }
    rig.pause = SLOW;
    rig.exchange(&image(3_000, 120));
    while rig.receive().is_some() {
        answered = answered.wrapping_add(1);
    }
    assert_eq!((answered, rig.status()), (sent, (OP, 0)));
    let echo = echo.0.borrow();
    assert_eq!((echo.torn, echo.last, echo.stops), (0, Some(3_000), 0));
}

#[test]
fn statement_45_no_event_and_no_message_is_lost_at_any_cycle() {
    for cycle_us in [100..=100, 250..=250, 1_000..=1_000, 4_000..=4_000, 1..=2_000] {
        cycles_with_messages(cycle_us);
    }
}

#[test]
fn statement_48_after_a_broken_link_it_comes_back_without_a_reset() {
    let mut rig = Rig::in_state(&MAILBOX_128, OP);
    rig.pass(5_000);
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x001b));
    // The MainDevice begins again: Init with acknowledgement, everything off, everything anew.
    assert_eq!(rig.request(INIT | ERROR), (INIT, 0));
    rig.write(0x0600, &[0; 48]);
    rig.write(0x0800, &[0; 32]);
    rig.bring_to(OP);
    assert_eq!(rig.cycle(9).1, 3);
    assert_eq!(rig.application().outputs, [9; 120]);
}

#[test]
fn inputs_are_renewed_by_the_local_clock_in_free_run() {
    let mut rig = Rig::new(&MAILBOX_128);
    rig.bring_to(PRE_OP);
    rig.download(0x1c32, 1, &[0, 0]).unwrap();
    rig.download(0x1c33, 1, &[0, 0]).unwrap();
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    let before = rig.application().fill;
    rig.pass(100);
    let renewed = rig.application().fill.wrapping_sub(before);
    assert!((99..=101).contains(&renewed), "once a millisecond, with no frame: {renewed}");
    rig.cycle(1);
    assert_eq!(rig.request(OP), (OP, 0));
    rig.cycle(2);
    assert_eq!(rig.application().outputs, [2; 120], "outputs are taken at once");
}

#[test]
fn inputs_are_renewed_with_the_frames_when_synchronous() {
    let mut rig = Rig::in_state(&MAILBOX_128, OP);
    let (first, _) = rig.cycle(1);
    rig.pass(50);
    let (second, _) = rig.cycle(1);
    assert_eq!(second[0], first[0].wrapping_add(1), "once for each frame, and not in between");
}

#[test]
fn an_alternative_assignment_has_its_own_size() {
    let mut rig = Rig::new(&MAILBOX_128);
    rig.bring_to(PRE_OP);
    rig.download_complete(0x1c12, 0, &[1, 0, 0x01, 0x16]).unwrap();
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, 0x001d), "120 bytes do not fit any more");
    set_anew(&mut rig, Channel::Outputs, |block| block[2] = 4);
    assert_eq!(rig.request(SAFE_OP | ERROR), (SAFE_OP, 0));
    assert_eq!(rig.write(MAILBOX_128.memory.start(Channel::Outputs), &[1, 2, 3, 4]), 1);
    assert_eq!(rig.request(OP), (OP, 0));
    assert_eq!(rig.application().outputs, [1, 2, 3, 4]);
}
