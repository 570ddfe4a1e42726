//! A SubDevice with distributed clocks (statements 46 and 47): settings that are refused, SYNC0 that does not come or is lost, outputs
//! and inputs at the SYNC signals, what is told about them, and ethercrab that runs it over SPI.

use embassy_time::Duration;
use ethercat_esc::bench::*;
use ethercat_esc::sub_device::{StepSetup, cable, direct, exchange_in_step, line_of, spawn, with_master};
use ethercat_esc::{SyncLine, World, now};
use ethercat_subdevice::application::Application;
use ethercat_subdevice::sub_device::SubDevice;

/// `cargo xtask bench ethercat` has more.
const CYCLES: u64 = 1_000;
const CYCLE_NS: u32 = 1_000_000;

/// Writes the SYNC unit's settings; the first pulse comes after `delay_ms`.
fn activate<A: Application + 'static>(rig: &mut Rig<A>, activation: u8, cycles: [u32; 2], delay_ms: u64) {
    rig.write(0x0981, &[0]);
    let time = u64::from_le_bytes(rig.read(0x0910, 8).unwrap().try_into().unwrap());
    rig.write(0x0990, &(time + delay_ms * 1_000_000).to_le_bytes());
    let [sync0, sync1] = cycles.map(u32::to_le_bytes);
    rig.write(0x09a0, &[sync0, sync1].concat());
    assert_eq!(rig.write(0x0981, &[activation]), 1);
}

fn clocked(state: u16) -> Rig<Bench> {
    let mut rig = Rig::new(&CLOCKED);
    rig.bring_to(PRE_OP);
    if state >= SAFE_OP {
        activate(&mut rig, 3, [CYCLE_NS, 0], 5);
        rig.set_up_process_data();
        assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    }
    if state >= OP {
        rig.write(0x0120, &[OP as u8, 0]);
        cycles(&mut rig, 20);
        assert_eq!(rig.status(), (OP, 0));
    }
    rig
}

/// Frames once a millisecond, in the middle between two pulses.
fn cycles(rig: &mut Rig<Bench>, count: usize) {
    for nth in 0..count {
        to_middle(rig);
        rig.cycle(nth as u8);
    }
    to_middle(rig);
}

/// Half a cycle behind the next pulse; those begin at whole milliseconds of the clock, which was read first in a fraction of one.
fn to_middle(rig: &mut Rig<Bench>) {
    let chip = rig.segment.chip(0);
    let pulses = move || chip.borrow().pulses_at_pin(SyncLine::Sync0).map_or(0, |(count, _)| count);
    let before = pulses();
    for _ in 0..30 {
        rig.world.run_for(Duration::from_micros(50));
        if pulses() != before {
            break;
        }
    }
    rig.world.run_for(Duration::from_micros(450));
}

/// How many images of outputs took effect, and the number of the inputs.
fn seen(rig: &Rig<Bench>) -> (usize, u8) {
    let application = rig.application();
    (application.images, application.fill)
}

fn number(bytes: &[u8]) -> u64 {
    bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}

#[test]
fn statement_46_settings_that_cannot_be_kept_are_refused_by_their_code() {
    for (control, activation, cycles, code) in [
        (0, 1, [CYCLE_NS, 0], 0x0030),
        (0, 5, [CYCLE_NS, 0], 0x0030),
        (0x10, 3, [CYCLE_NS, 0], 0x0031),
        (0, 3, [0, 0], 0x0036),
        (0, 3, [20_000, 0], 0x0036),
        (0, 3, [1_000_000_001, 0], 0x0035),
        (0, 7, [500_000_000, 1_000_000_000], 0x0035),
    ] {
        let mut rig = clocked(PRE_OP);
        activate(&mut rig, activation, cycles, 5);
        rig.write(0x0980, &[control]);
        rig.set_up_process_data();
        assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, code), "{control:x} {activation} {cycles:?}");
        // Acknowledged and with good ones it goes on.
        rig.write(0x0980, &[0]);
        activate(&mut rig, 3, [CYCLE_NS, 0], 5);
        assert_eq!(rig.request(SAFE_OP | ERROR), (SAFE_OP, 0));
    }
}

#[test]
fn statement_46_synchronisation_by_clocks_without_an_active_unit_is_refused() {
    let mut rig = clocked(PRE_OP);
    for index in [0x1c32, 0x1c33] {
        rig.download(index, 1, &[2, 0]).unwrap();
    }
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (PRE_OP | ERROR, 0x0030));
    activate(&mut rig, 3, [CYCLE_NS, 0], 5);
    assert_eq!(rig.request(SAFE_OP | ERROR), (SAFE_OP, 0));
}

#[test]
fn statement_46_without_sync0_op_is_refused_with_002d() {
    let mut rig = clocked(PRE_OP);
    // It would start in half a minute.
    activate(&mut rig, 3, [CYCLE_NS, 0], 30_000);
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    rig.write(0x0120, &[OP as u8, 0]);
    for _ in 0..1_100 {
        rig.pass(1);
        rig.cycle(1);
    }
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x002d));
    assert_eq!(rig.application().images, 0, "no outputs took effect");
}

#[test]
fn statement_46_op_needs_frames_in_step_with_sync0() {
    let mut rig = clocked(SAFE_OP);
    rig.write(0x0120, &[OP as u8, 0]);
    rig.pass(1_100);
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x001b), "no frame at all");
    rig.write(0x0120, &[(OP | ERROR) as u8, 0]);
    for _ in 0..400 {
        rig.pass(3);
        rig.cycle(1);
    }
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x0032), "a frame in every third cycle");
    rig.write(0x0120, &[(OP | ERROR) as u8, 0]);
    cycles(&mut rig, 20);
    assert_eq!(rig.status(), (OP, 0));
}

#[test]
fn statement_46_a_lost_sync0_ends_op_with_002c() {
    let mut rig = clocked(OP);
    rig.write(0x0981, &[0]);
    for _ in 0..2 {
        rig.pass(1);
        rig.cycle(7);
    }
    assert_eq!(rig.status(), (OP, 0), "it may be late");
    for _ in 0..3 {
        rig.pass(1);
        rig.cycle(7);
    }
    assert_eq!(rig.status(), (SAFE_OP | ERROR, 0x002c));
    assert_eq!(rig.application().stops, 1);
    // The pulses come back, and Op with them.
    activate(&mut rig, 3, [CYCLE_NS, 0], 2);
    rig.write(0x0120, &[(OP | ERROR) as u8, 0]);
    cycles(&mut rig, 20);
    assert_eq!(rig.status(), (OP, 0));
}

#[test]
fn statement_46_too_many_cycles_without_outputs_end_op_with_0034_if_there_is_a_limit() {
    for (limit, lost, status) in
        [(0, 20, (OP, 0)), (4, 1, (OP, 0)), (4, 2, (SAFE_OP | ERROR, 0x0034)), (30, 8, (OP, 0))]
    {
        let mut rig = clocked(OP);
        rig.download(0x10f1, 2, &[limit, 0]).unwrap();
        cycles(&mut rig, 40);
        let missed = number(&rig.upload(0x1c32, 0x0b).unwrap());
        (0..lost).for_each(|_| to_middle(&mut rig));
        assert_eq!(rig.status(), status, "{lost} of {limit}");
        if status.0 == OP {
            let now_missed = number(&rig.upload(0x1c32, 0x0b).unwrap());
            assert!(now_missed >= missed + lost, "{now_missed} after {missed} and {lost}");
        }
    }
}

#[test]
fn statement_46_what_is_in_force_is_told() {
    let mut rig = clocked(PRE_OP);
    let told =
        |rig: &mut Rig<Bench>, index| [1, 2, 3, 4, 0x0a].map(|sub| number(&rig.upload(index, sub).unwrap()));
    assert_eq!(told(&mut rig, 0x1c32), [0x01, 0, 0, 0x07, 0]);
    assert_eq!(told(&mut rig, 0x1c33), [0x22, 0, 0, 0x0f, 0]);
    activate(&mut rig, 7, [CYCLE_NS, 3_250_000], 5);
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    assert_eq!(told(&mut rig, 0x1c32), [2, 4_000_000, 0, 0x07, 1_000_000]);
    assert_eq!(told(&mut rig, 0x1c33), [3, 4_000_000, 250_000, 0x0f, 1_000_000]);
    assert_eq!(rig.request(PRE_OP), (PRE_OP, 0));
    assert_eq!(told(&mut rig, 0x1c33)[0], 0x22);
}

#[test]
fn statement_46_a_device_without_clocks_does_not_take_their_types() {
    let mut rig = Rig::in_state(&MAILBOX_128, PRE_OP);
    assert_eq!(number(&rig.upload(0x1c32, 4).unwrap()), 3);
    assert_eq!(rig.download(0x1c32, 1, &[2, 0]), Err(0x0609_0030));
    assert_eq!(rig.download(0x1c33, 1, &[3, 0]), Err(0x0609_0030));
}

#[test]
fn statement_46_a_device_whose_board_has_no_signals_offers_none() {
    let mut world = World::new(1);
    let line = line_of(&CLOCKED);
    let (esc, interrupt) = direct(line.borrow().chip(0));
    spawn(&world, SubDevice::new(&CLOCKED, esc, Bench::default()), interrupt);
    with_master(&mut world, cable(line), async |dispatcher| {
        let group = dispatcher.to_pre_op().await.unwrap();
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        assert_eq!(device.sdo_read::<u16>(0x1c32, 4).await.unwrap(), 3);
        assert_eq!(device.sdo_read::<u16>(0x1c33, 4).await.unwrap(), 3);
        device.register_write(0x0981u16, 3u8).await.unwrap();
        assert!(group.into_safe_op(dispatcher.master).await.is_err());
    });
}

#[test]
fn outputs_take_effect_and_inputs_are_sampled_at_sync0_and_at_no_other_time() {
    let mut rig = clocked(OP);
    to_middle(&mut rig);
    let (images, fill) = seen(&rig);
    rig.cycle(77);
    rig.world.run_for(Duration::from_micros(200));
    assert_eq!(seen(&rig), (images, fill), "before the pulse");
    to_middle(&mut rig);
    assert_eq!(seen(&rig), (images + 1, fill.wrapping_add(1)));
    assert_eq!(rig.application().outputs, [77; 120]);
    to_middle(&mut rig);
    assert_eq!(seen(&rig), (images + 1, fill.wrapping_add(2)));
}

#[test]
fn at_sync1_inputs_are_sampled_and_a_frame_has_several_cycles() {
    let mut rig = clocked(PRE_OP);
    // SYNC1 at every fourth SYNC0, and 250 us behind it.
    activate(&mut rig, 7, [CYCLE_NS, 3_250_000], 5);
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    rig.write(0x0120, &[OP as u8, 0]);
    let four = |rig: &mut Rig<Bench>| {
        rig.cycle(9);
        (0..4).for_each(|_| to_middle(rig));
    };
    (0..8).for_each(|_| four(&mut rig));
    assert_eq!(rig.status(), (OP, 0));
    let missed = rig.upload(0x1c32, 0x0b).unwrap();
    let (images, fill) = seen(&rig);
    (0..5).for_each(|_| four(&mut rig));
    assert_eq!(rig.application().images, images + 5);
    let sampled = rig.application().fill.wrapping_sub(fill);
    assert!((5..=6).contains(&sampled), "once in four cycles: {sampled}");
    assert_eq!(rig.upload(0x1c32, 0x0b).unwrap(), missed, "none of the cycles between counts as missed");
}

#[test]
fn statement_46_free_run_goes_on_while_clocks_are_off() {
    let mut rig = clocked(PRE_OP);
    rig.download(0x1c32, 1, &[0, 0]).unwrap();
    rig.download(0x1c33, 1, &[0, 0]).unwrap();
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    rig.cycle(1);
    assert_eq!(rig.request(OP), (OP, 0));
    rig.cycle(2);
    assert_eq!(rig.application().outputs, [2; 120]);
}

#[test]
fn statement_47_a_start_in_the_past_gives_no_pulse_and_no_op() {
    let mut rig = clocked(PRE_OP);
    rig.pass(10);
    rig.write(0x0990, &(now() / 2).to_le_bytes());
    rig.write(0x09a0, &CYCLE_NS.to_le_bytes());
    rig.write(0x0981, &[3]);
    assert_eq!(rig.read(0x0984, 1).unwrap()[0] & 4, 4, "the controller tells");
    rig.set_up_process_data();
    assert_eq!(rig.request(SAFE_OP), (SAFE_OP, 0));
    rig.write(0x0120, &[OP as u8, 0]);
    for _ in 0..1_100 {
        rig.pass(1);
        rig.cycle(1);
    }
    assert_eq!((rig.status(), rig.segment.chip(0).borrow().sync0_pulses()), ((SAFE_OP | ERROR, 0x002d), 0));
}

#[test]
fn over_spi_outputs_take_effect_within_5_us_and_inputs_are_no_older_than_a_cycle_and_20_us() {
    for with_mail in [false, true] {
        let setup = StepSetup { with_mail, ..StepSetup::h743(1_000, 500, CYCLES) };
        let result = exchange_in_step(&CLOCKED, setup).unwrap();
        println!("{result:?}");
        assert!(result.jitter_ns() <= 5_000, "{:?}", result.outputs_ns);
        assert!(result.input_age <= setup.cycle + Duration::from_micros(20));
        assert_eq!(result.bad(), 0);
        assert_eq!(with_mail, result.mails > 100);
        let cost = result.traffic.0;
        assert!(with_mail || cost.bytes <= 320 && cost.selects <= 9, "as without clocks: {cost:?}");
    }
}

#[test]
fn no_image_is_lost_at_250_us_with_120_bytes_and_at_125_us_with_16() {
    for (device, cycle_us, shift_us) in [(&CLOCKED, 250, 50), (&CLOCKED_16, 125, 0)] {
        let result = exchange_in_step(device, StepSetup::h743(cycle_us, shift_us, CYCLES)).unwrap();
        println!("{result:?}");
        assert_eq!(result.bad(), 0);
        assert!(result.jitter_ns() <= 5_000, "{:?}", result.outputs_ns);
    }
}
