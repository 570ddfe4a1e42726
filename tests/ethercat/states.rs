//! Conformance: the state machine, its error codes, the process data watchdog (statements 1 to 20).

use ethercat_subdevice::al_state::AlStatusCode;
use mobgate_simulator::esc::Segment;

use crate::prelude::*;

fn rig() -> Rig<Bench> {
    Rig::new(&MAILBOX_128)
}

fn in_state(state: u16) -> Rig<Bench> {
    Rig::in_state(&MAILBOX_128, state)
}

#[test]
fn statement_01_after_power_on_it_is_in_init_without_error_and_needs_no_processor_for_that() {
    let _world = World::new(1);
    let mut alone = Segment::new([Chip::new(Kind::LAN9252, sii_of(&MAILBOX_128).to_vec())]);
    assert_eq!(alone.fetch(0, 0x0130, 6).unwrap(), [1, 0, 0, 0, 0, 0]);
    assert_eq!(alone.fetch(0, 0x0110, 1).unwrap()[0] & 1, 1, "the EEPROM was loaded");
    drop(_world);
    assert_eq!(rig().status(), (INIT, 0), "nor does the processor change it");
}

#[test]
fn statement_02_pre_op_is_reached_with_good_mailboxes() {
    let mut rig = rig();
    rig.set_up_mailboxes();
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
}

#[test]
fn statement_03_a_wrong_mailbox_stays_in_init() {
    for channel in [Channel::MailboxOut, Channel::MailboxIn] {
        // Start, length, mode, direction, event for the processor, enable.
        const CHANGES: [(usize, u8); 8] =
            [(0, 0x01), (1, 0x01), (2, 0x01), (2, 0xff), (4, 0x02), (4, 0x04), (4, 0x20), (6, 0x01)];
        for (at, change) in CHANGES {
            let mut rig = rig();
            rig.set_up_mailboxes();
            set_anew(&mut rig, channel, |block| block[at] ^= change);
            assert_eq!(rig.request(PRE_OP), (INIT | ERROR, 0x0016), "{channel:?}, byte {at} ^ {change:#x}");
        }
    }
}

#[test]
fn statement_04_a_state_cannot_be_skipped() {
    for (from, to) in [(INIT, SAFE_OP), (INIT, OP), (PRE_OP, OP)] {
        assert_eq!(in_state(from).request(to), (from | ERROR, 0x0011));
    }
}

#[test]
fn statement_05_states_that_do_not_exist_are_refused() {
    for from in [INIT, PRE_OP, SAFE_OP, OP] {
        for wanted in [0, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15] {
            assert_eq!(in_state(from).request(wanted), (from | ERROR, 0x0012), "{from} to {wanted}");
        }
    }
}

#[test]
fn statement_06_boot_is_not_offered() {
    const BOOT: u16 = 3;
    assert_eq!(in_state(INIT).request(BOOT), (INIT | ERROR, 0x0013));
    for from in [PRE_OP, SAFE_OP] {
        assert_eq!(in_state(from).request(BOOT), (from | ERROR, 0x0011));
    }
}

#[test]
fn statement_07_an_error_stands_until_it_is_acknowledged_or_init_is_asked_for() {
    let mut rig = in_state(PRE_OP);
    assert_eq!(rig.request(OP), (PRE_OP | ERROR, 0x0011));
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, 0x0011), "without acknowledgement nothing changes");
    assert_eq!(rig.request(SAFE_OP | ERROR), (SAFE_OP, 0), "with it the state is taken");
    assert_eq!(rig.request(5), (SAFE_OP | ERROR, 0x0012));
    assert_eq!(rig.request(INIT), (INIT, 0), "Init needs none");
}

#[test]
fn statement_08_a_flag_is_never_seen_without_its_code() {
    // Every access of the processor takes 5 us, and the MainDevice looks at every one.
    let reach = |chip| {
        let (esc, interrupt) = direct(chip);
        (Paced::new(esc, Random::new(8), 5..=5), interrupt)
    };
    let mut rig = Rig::reached_by(&MAILBOX_128, Bench::default(), Duration::from_millis(2), reach);
    let (mut raised, mut ended) = (0, 0);
    let mut before = false;
    for control in [OP, PRE_OP | ERROR, 5, INIT, SAFE_OP, INIT | ERROR] {
        assert_eq!(rig.segment.poke(0, 0x0120, &control.to_le_bytes()), 1);
        for _ in 0..1_000 {
            rig.world.run_for(Duration::from_micros(1));
            let bytes = rig.segment.fetch(0, 0x0130, 6).unwrap();
            let flag = bytes[0] & 0x10 != 0;
            assert!(!flag || bytes[4] != 0, "{bytes:02x?}");
            raised += u32::from(flag && !before);
            ended += u32::from(before && !flag);
            before = flag;
        }
    }
    assert_eq!((raised, ended), (2, 2), "errors came and went");
}

#[test]
fn statement_09_the_same_state_again_is_no_error() {
    for state in [PRE_OP, SAFE_OP, OP] {
        let mut rig = in_state(state);
        assert_eq!(rig.request(state), (state, 0));
        assert!(rig.upload(0x1000, 0).is_ok(), "and the mailbox goes on");
    }
}

/// Asks for SafeOp with one field of one SyncManager changed.
fn safe_op_with(channel: Channel, at: usize, change: u8) -> (u16, u16) {
    let mut rig = in_state(PRE_OP);
    rig.set_up_process_data();
    set_anew(&mut rig, channel, |block| block[at] ^= change);
    rig.request(SAFE_OP)
}

#[test]
fn statement_10_process_data_that_do_not_fit_stay_in_pre_op() {
    for (channel, code) in [(Channel::Outputs, 0x001d), (Channel::Inputs, 0x001e)] {
        // Length, start (also over the other's buffers), direction, mode, event for the processor.
        for (at, change) in [(2, 0x01), (3, 0x01), (0, 0x08), (1, 0x03), (4, 0x04), (4, 0x02), (4, 0x20)] {
            let state = safe_op_with(channel, at, change);
            assert_eq!(state, (PRE_OP | ERROR, code), "{channel:?} {at} {change}");
        }
    }
}

#[test]
fn statement_11_a_sync_manager_is_on_exactly_when_it_has_bytes() {
    assert_eq!(safe_op_with(Channel::Outputs, 6, 1), (PRE_OP | ERROR, 0x001d));
    assert_eq!(safe_op_with(Channel::Inputs, 6, 1), (PRE_OP | ERROR, 0x001e));

    for (assignment, channel, code) in [(0x1c12, Channel::Outputs, 0x001d), (0x1c13, Channel::Inputs, 0x001e)]
    {
        let mut rig = in_state(PRE_OP);
        rig.set_up_process_data();
        rig.download(assignment, 0, &[0]).unwrap();
        assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, code));
        rig.write(channel.registers() + 6, &[0]);
        assert_eq!(rig.request(SAFE_OP | ERROR), (SAFE_OP, 0));
    }
}

#[test]
fn statement_12_op_is_refused_when_no_outputs_come() {
    let mut rig = in_state(SAFE_OP);
    assert_eq!(rig.request(OP), (SAFE_OP, 0), "it waits for them");
    rig.pass(1_100);
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x001b));
    assert_eq!(rig.application().images, 0);
    rig.cycle(7);
    assert_eq!(rig.request(OP | ERROR), (OP, 0), "events came through afterwards");
    assert_eq!(rig.application().outputs, [7; 120]);
}

#[test]
fn statement_12_op_is_reached_as_soon_as_outputs_come() {
    let mut rig = in_state(SAFE_OP);
    rig.request(OP);
    rig.pass(500);
    rig.cycle(7);
    assert_eq!(rig.status(), (OP, 0));
    assert_eq!(rig.application().outputs, [7; 120]);
}

#[test]
fn statement_13_in_op_the_watchdog_leads_to_safe_op() {
    let mut rig = in_state(OP);
    for _ in 0..50 {
        rig.pass(10);
        rig.cycle(1);
    }
    assert_eq!(rig.status(), (OP, 0));
    rig.pass_since_exchange(98);
    assert_eq!(rig.application().stops, 0, "not before its time");
    assert_eq!(rig.status(), (OP, 0));
    rig.pass(10);
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x001b));
    assert_eq!(rig.application().stops, 1, "the application heard of it");

    rig.cycle(2);
    assert_eq!(rig.application().outputs, [1; 120], "in SafeOp outputs have no effect");
    assert_eq!(rig.request(OP | ERROR), (OP, 0));
    assert_eq!(rig.application().outputs, [2; 120]);
}

#[test]
fn statement_13_outputs_of_before_the_watchdog_do_not_lead_to_op_again() {
    let mut rig = in_state(OP);
    rig.cycle(7);
    rig.pass(110);
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x001b));
    assert_eq!(rig.request(OP | ERROR), (SAFE_OP, 0), "it waits for new ones");
    rig.pass(1_100);
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x001b));

    // Nor do those that came and stopped in SafeOp.
    rig.cycle(8);
    rig.pass(110);
    let images = rig.application().images;
    assert_eq!(rig.request(OP | ERROR), (SAFE_OP, 0));
    assert_eq!(rig.application().images, images, "the application got none of them");
}

#[test]
fn statement_16_outputs_of_before_pre_op_do_not_lead_to_op_again() {
    let mut rig = in_state(OP);
    // No watchdog, which would end them too.
    rig.write(0x0420, &[0, 0]);
    rig.cycle(7);
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    let images = rig.application().images;
    assert_eq!(rig.request(OP), (SAFE_OP, 0), "it waits for new ones");
    assert_eq!(rig.application().images, images);
    rig.cycle(9);
    assert_eq!(rig.status(), (OP, 0));
    assert_eq!(rig.application().outputs, [9; 120]);
}

#[test]
fn statement_14_a_watchdog_of_0_never_ends_op() {
    let mut rig = in_state(SAFE_OP);
    rig.write(0x0420, &[0, 0]);
    rig.cycle(1);
    assert_eq!(rig.request(OP), (OP, 0));
    rig.pass(10_000);
    assert_eq!(rig.status(), (OP, 0));
}

#[test]
fn statement_14_the_watchdogs_divider_counts() {
    let mut rig = in_state(SAFE_OP);
    // A tick of 10 us instead of 100, so that 1000 of them are 10 ms.
    rig.write(0x0400, &248u16.to_le_bytes());
    rig.cycle(1);
    assert_eq!(rig.request(OP), (OP, 0));
    rig.pass_since_exchange(9);
    assert_eq!(rig.status(), (OP, 0));
    rig.pass_since_exchange(15);
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x001b));
}

#[test]
fn statement_15_a_sync_manager_that_is_switched_off_ends_process_data() {
    for (channel, expected) in [
        (Channel::Outputs, (PRE_OP | ERROR, 0x001d)),
        (Channel::Inputs, (PRE_OP | ERROR, 0x001e)),
        (Channel::MailboxOut, (INIT | ERROR, 0x0016)),
        (Channel::MailboxIn, (INIT | ERROR, 0x0016)),
    ] {
        for state in [SAFE_OP, OP] {
            let mut rig = in_state(state);
            rig.write(channel.registers() + 6, &[0]);
            assert_eq!(rig.status(), expected, "{channel:?} in {state}");
            assert_eq!(rig.application().stops, usize::from(state == OP));
        }
    }
}

#[test]
fn statement_16_going_down_is_immediate_and_ends_process_data() {
    for (from, to) in
        [(OP, SAFE_OP), (OP, PRE_OP), (OP, INIT), (SAFE_OP, PRE_OP), (SAFE_OP, INIT), (PRE_OP, INIT)]
    {
        let mut rig = in_state(from);
        assert_eq!(rig.request(to), (to, 0));
        assert_eq!(rig.application().stops, usize::from(from == OP));
        let images = rig.application().images;
        rig.cycle(9);
        assert_eq!(rig.application().images, images);
        if to == PRE_OP {
            assert!(rig.upload(0x1000, 0).is_ok(), "the mailbox lives on");
        }
    }
}

#[test]
fn statement_17_the_first_frame_in_safe_op_has_the_full_working_counter() {
    let mut rig = in_state(SAFE_OP);
    let (inputs, counter) = rig.cycle(0);
    assert_eq!((inputs, counter), (vec![1; 120], 3));
}

#[test]
fn statement_18_init_and_back_leaves_nothing_of_the_mailbox() {
    let mut rig = in_state(PRE_OP);
    // An upload that is not read to its end, and a response that is not fetched.
    assert!(rig.sdo(&[0x40, 0x00, 0x21, 0]).is_ok());
    assert_eq!(rig.send_counted(3, 5, &[0, 0x20, 0x60, 0, 0, 0, 0, 0, 0, 0]), 1);
    assert_eq!(rig.request(INIT), (INIT, 0));
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
    assert_eq!(rig.receive(), None, "no response of before");
    assert_eq!(rig.send_counted(3, 5, &[0, 0x20, 0x60, 0, 0, 0, 0, 0, 0, 0]), 1);
    let response = rig.receive().expect("the counter of before is forgotten");
    assert_eq!(response[5] >> 4, 1, "the device's own too");
    assert_eq!(response[12..], [0x01, 0x00, 0x04, 0x05], "and so is the upload");
}

#[test]
fn statement_19_a_second_request_before_the_first_was_seen_is_not_taken() {
    let mut rig = in_state(PRE_OP);
    assert_eq!(rig.segment.poke(0, 0x0120, &[1, 0]), 1);
    assert_eq!(rig.segment.poke(0, 0x0120, &[4, 0]), 0);
    rig.pass(1);
    assert_eq!(rig.status(), (INIT, 0));
}

#[test]
fn statement_20_the_alias_identifies_the_device_on_request() {
    let mut rig = in_state(PRE_OP);
    let chip = rig.segment.chip(0);
    chip.borrow_mut().write(0, 0x0012, &[0x34, 0x12]);
    assert_eq!(rig.request(PRE_OP | 0x20), (PRE_OP | 0x20, 0x1234));
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
}

#[test]
fn statement_20_without_an_identification_none_is_shown() {
    let mut rig = in_state(PRE_OP);
    assert_eq!(rig.request(PRE_OP | 0x20), (PRE_OP, 0), "0 is none");
}

#[test]
fn statement_54_after_a_reset_of_the_chip_the_device_is_in_init_with_0060_and_comes_back() {
    let (mut rig, chip) = behind_spi(InterruptPin::High, Timing::USUAL);
    rig.bring_to(OP);
    chip.reset();
    rig.pass(200);
    assert_eq!(rig.status(), (INIT | ERROR, 0x0060));
    assert_eq!(rig.application().stops, 1, "outputs are not valid any more");
    assert_eq!(rig.request(INIT | ERROR), (INIT, 0));
    rig.bring_to(OP);
}

#[test]
fn the_application_may_refuse_a_state_with_its_own_code() {
    for (state, from, to) in
        [(AlState::PreOp, INIT, PRE_OP), (AlState::SafeOp, PRE_OP, SAFE_OP), (AlState::Op, SAFE_OP, OP)]
    {
        let mut rig = in_state(from);
        rig.application().refuses = Some((state, AlStatusCode::HardwareNotReady));
        rig.set_up_mailboxes();
        if from == PRE_OP {
            rig.set_up_process_data();
        }
        assert_eq!(rig.request(to), (from | ERROR, 0x0052));
    }
}

#[test]
fn distributed_clocks_that_are_active_are_refused() {
    let mut rig = in_state(PRE_OP);
    rig.set_up_process_data();
    rig.write(0x0981, &[3]);
    assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, 0x0030));
    rig.write(0x0981, &[0]);
    assert_eq!(rig.request(SAFE_OP | ERROR), (SAFE_OP, 0));
}

#[test]
fn synchronisation_must_be_the_same_in_both_directions() {
    let mut rig = in_state(PRE_OP);
    rig.set_up_process_data();
    rig.download(0x1c32, 1, &[0, 0]).unwrap();
    assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, 0x0028));
    rig.download(0x1c33, 1, &[0, 0]).unwrap();
    assert_eq!(rig.request(SAFE_OP | ERROR), (SAFE_OP, 0));
}
