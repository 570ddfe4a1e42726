//! What the gateway does besides exchanging values: without a configuration, before and after Op, with devices that are not well.

use super::bench::{MS, SETUP, Setup, with_devices};
use crate::prelude::*;

#[test]
fn while_the_flag_is_reset_there_is_no_traffic_and_the_buffers_keep_their_values() {
    with_devices(SETUP, async |bench| {
        let group = bench.dispatcher.to_pre_op().await.unwrap();
        bench.configure(&group).await;
        let group = bench.to_op(group, &bench.output_image()).await;
        bench.cycle_for(&group, 1_000 * MS).await;
        let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
        gateway.sdo_write(0x2005, 2, 0_u16).await.unwrap();
        // What is on the wire comes to its end.
        bench.cycle_for(&group, 20 * MS).await;
        let before = bench.requests();
        bench.cycle_for(&group, 1_000 * MS).await;
        assert_eq!(bench.requests(), before);
        let image = bench.input_image();
        let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
        assert_eq!(gateway.inputs_raw()[..image.len()], image);
        gateway.sdo_write(0x2000, 1, 1_u16).await.unwrap();
        gateway.sdo_write(0x2005, 1, 1_u16).await.unwrap();
        bench.cycle_for(&group, 1_000 * MS).await;
        let first = &bench.virtuals[0].input_image;
        let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
        assert_eq!(gateway.inputs_raw()[..first.len()], *first);
        assert_eq!(gateway.inputs_raw()[first.len()..], vec![0; 120 - first.len()], "one device only");
    });
}

/// Leaves Op with the outputs of the vectors in force; somebody changes a register at the device. What the register holds later.
fn after_loss(on_loss: &'static str) -> u16 {
    let mut found = 0;
    with_devices(Setup { on_loss, ..SETUP }, async |bench| {
        let group = bench.dispatcher.to_pre_op().await.unwrap();
        bench.configure(&group).await;
        let group = bench.to_op(group, &bench.output_image()).await;
        bench.cycle_for(&group, 1_000 * MS).await;
        assert_eq!(bench.devices[0].memory().holding[40_010], 10);
        group.into_safe_op(bench.dispatcher.master).await.unwrap();
        bench.devices[0].memory().holding[40_010] = 99;
        Timer::after_secs(1).await;
        found = bench.devices[0].memory().holding[40_010];
    });
    found
}

#[test]
fn when_op_is_left_outputs_are_held_cleared_or_not_written_any_more() {
    assert_eq!(after_loss("hold"), 10);
    assert_eq!(after_loss("clear"), 0);
    assert_eq!(after_loss("stop"), 99);
}

#[test]
fn outputs_have_no_effect_before_op() {
    with_devices(SETUP, async |bench| {
        let group = bench.dispatcher.to_pre_op().await.unwrap();
        bench.configure(&group).await;
        let group = group.into_safe_op(bench.dispatcher.master).await.unwrap();
        group.subdevice(bench.dispatcher.master, 0).unwrap().outputs_raw_mut()[0] = 0xff;
        for _ in 0..200 {
            group.tx_rx(bench.dispatcher.master).await.unwrap();
            Timer::after_millis(5).await;
        }
        assert!(bench.requests() > 0);
        assert_eq!(bench.writes(), 0);
        let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
        assert_eq!(gateway.inputs_raw()[3], 7, "inputs come in SafeOp");
    });
}

#[test]
fn the_master_sees_which_device_is_well_and_the_others_go_on() {
    with_devices(SETUP, async |bench| {
        bench.devices[1].set_faults(Faults::new(1).with(When::Always, Fault::Dead));
        let group = bench.dispatcher.to_pre_op().await.unwrap();
        let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
        assert_eq!(gateway.sdo_read::<u32>(0x2180, 2).await.unwrap(), u32::MAX, "never heard of");
        for (pdo, sub) in [(0x1a00_u16, 1), (0x1a03, 2)] {
            gateway.sdo_write(0x1c13, 0, 0_u8).await.unwrap();
            gateway.sdo_write(0x1c13, sub, pdo).await.unwrap();
        }
        gateway.sdo_write(0x1c13, 0, 2_u8).await.unwrap();
        bench.configure(&group).await;
        let group = bench.to_op(group, &bench.output_image()).await;
        bench.cycle_for(&group, 5_000 * MS).await;
        let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
        assert_eq!(gateway.inputs_raw()[120..], [1, 2, 1, 1], "the status bytes behind the inputs");
        let health = async |nth: u16| gateway.sdo_read::<u8>(0x2180 + nth, 1).await.unwrap();
        assert_eq!([health(0).await, health(1).await, health(2).await, health(3).await], [1, 2, 1, 1]);
        assert_eq!(gateway.sdo_read::<u8>(0x2181, 4).await.unwrap(), 5, "no response");
        assert_eq!(gateway.sdo_read::<u32>(0x2181, 6).await.unwrap(), 0);
        assert!(gateway.sdo_read::<u32>(0x2181, 8).await.unwrap() >= 3);
        assert!(gateway.sdo_read::<u32>(0x2182, 2).await.unwrap() < 200, "heard of lately");
        let (third, from) = (&bench.virtuals[2].input_image, usize::from(bench.virtuals[2].layout[0]));
        assert_eq!(gateway.inputs_raw()[from..from + third.len()], *third);
    });
}

#[test]
fn a_device_that_is_to_be_checked_is_asked_for_a_sign_of_life_before_each_poll() {
    with_devices(Setup { polling_ms: 250, ..SETUP }, async |bench| {
        let group = bench.dispatcher.to_pre_op().await.unwrap();
        let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
        gateway.sdo_write(0x2007, 3, 1_u8).await.unwrap();
        bench.configure(&group).await;
        Timer::after_secs(2).await;
        let checks = |nth: usize| bench.devices[nth].counters().requests[8];
        let polls = bench.devices[2].counters().requests[1];
        assert!(polls >= 7 && checks(2).abs_diff(polls) <= 1, "{} checks, {polls} polls", checks(2));
        assert_eq!([checks(0), checks(1), checks(3)], [0; 3]);
    });
}

#[test]
fn statement_20_the_settings_identify_the_gateway_and_without_them_the_alias_does() {
    let objects = gateway_objects();
    let place = objects.shared();
    let mut rig = Rig::with_application(&GATEWAY, objects);
    rig.segment.chip(0).borrow_mut().write(0, 0x0012, &[0x34, 0x12]);
    let mut settings = Settings::new();
    for (line, id) in [
        ("port ecat ethercat id 17", 17),
        ("edit port ecat id 65535", 65_535),
        ("edit port ecat id alias", 0x1234),
    ] {
        apply(&mut settings, line).unwrap();
        place.follow(&settings, false);
        // In Init, as the specification has it, without a mailbox.
        assert_eq!(rig.request(INIT | 0x20), (INIT | 0x20, id), "{line}");
        assert_eq!(rig.request(INIT), (INIT, 0));
    }
}
