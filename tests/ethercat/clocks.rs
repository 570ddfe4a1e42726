//! The gateway by distributed clocks; what a SubDevice does by them is in the tests of `ethercat/emulator`.

use ethercrab::DcSync;
use mobgate_simulator::sub_device::in_step;

use crate::prelude::*;

#[test]
fn statement_47_ethercrab_runs_the_gateway_by_distributed_clocks() {
    let mut world = World::new(1);
    let line = line_of(&GATEWAY);
    let chip = line.borrow().chip(0);
    let signals = note_pulses(&world, &chip, Duration::MIN);
    let (esc, interrupt) = direct(chip.clone());
    let objects = Shared::new(gateway_objects());
    spawn(&world, SubDevice::new(&GATEWAY, esc, objects.clone()).with_sync(Some(signals)), interrupt);
    with_master(&mut world, cable(line), async |dispatcher| {
        let (cycle, shift) = (Duration::from_millis(1), Duration::from_micros(300));
        let group = in_step(&dispatcher, cycle, shift, DcSync::Sync0).await.unwrap();
        let (mut before, mut differences) = (0, Vec::new());
        for _ in 0..1_000 {
            let response = group.tx_rx_dc(dispatcher.master).await.unwrap();
            assert_eq!(response.working_counter, 3);
            let time = response.extra.dc_system_time;
            assert!(time > before, "it runs steadily");
            differences.push(time - before);
            before = time;
            Timer::after_micros(response.extra.next_cycle_wait.as_micros() as u64).await;
        }
        let device = group.subdevice(dispatcher.master, 0).unwrap();
        assert_eq!(device.sdo_read::<u16>(0x1c32, 1).await.unwrap(), 2);
        assert_eq!(device.sdo_read::<u32>(0x1c32, 2).await.unwrap(), 1_000_000);
        assert!(differences[1..].iter().all(|nanos| nanos.abs_diff(1_000_000) < 2_000), "{differences:?}");
    });
    assert!(objects.0.borrow().outputs_valid());
    assert!(chip.borrow().sync0_pulses() > 1_000);
}
