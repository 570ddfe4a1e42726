//! Each command for data points, typed at the console of a gateway with a device on its line.

use mobgate_simulator::console::typed_slowly;

use crate::prelude::*;

const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1
    port scan scanner
    route scan 5 * * bus
    device meter unit 5 label \"Main meter\"
    point speed meter holding 0 count 2 read manual label \"Speed, rpm\"
    point limit meter holding 7 read manual
    point ramp meter holding 20 count 3 write auto read manual
    point lamp meter coil 3 read manual
    point live meter holding 40 read high";

/// A gateway that has asked its device for what is read by itself.
fn with_device(scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, Device)) {
    with_gateway(1, SETTINGS, |world, rig| {
        let device = Device::new(5);
        rig.attach(world, "uart1", [device.clone()]);
        world.run_for(SECOND);
        scenario(world, rig, device);
    });
}

/// The requests that changed something since this was asked last.
fn writes(device: &Device) -> Vec<Vec<u8>> {
    device.take_writes().into_iter().map(|write| write.pdu).collect()
}

#[test]
fn read_asks_the_device_at_once_and_shows_status_and_values() {
    with_device(|world, rig, device| {
        device.memory().holding[1] = 4_711;
        let asked = device.counters().requests[3];
        let said = world.run_until(typed(rig.gateway, "read speed\n"));
        assert!(said.contains("0002h ok; 0.0s old; Speed, rpm\n  [0] 1280 4711\n"), "{said}");
        // `live` may have been read meanwhile.
        assert!((1..=2).contains(&(device.counters().requests[3] - asked)));
    });
}

#[test]
fn write_sends_the_values_at_once_by_hand_and_automatically() {
    with_device(|world, rig, device| {
        let said = world.run_until(typed(rig.gateway, "write limit 99\nwrite ramp 1 2 3\nwrite lamp on\n"));
        assert_eq!(said.matches("0802h ok wrote;").count(), 3, "{said}");
        let expected =
            [vec![6, 0, 7, 0, 99], vec![16, 0, 20, 0, 3, 6, 0, 1, 0, 2, 0, 3], vec![5, 0, 3, 0xff, 0]];
        assert_eq!(writes(&device), expected);
    });
}

#[test]
fn mark_reads_or_writes_all_points_in_a_range_of_addresses_by_the_function() {
    with_device(|world, rig, device| {
        let asked = device.counters().requests;
        world.run_until(typed(rig.gateway, "mark meter 3 0-21\nmark meter 1 0-100\n"));
        world.run_for(150 * MS);
        let now = device.counters().requests;
        assert_eq!(now[1] - asked[1], 1, "the lamp");
        assert!((3..=4).contains(&(now[3] - asked[3])), "speed, limit and ramp");
        assert_eq!(writes(&device), [[0; 0]; 0]);
        world.run_until(typed(rig.gateway, "mark meter 16 7-20\n"));
        world.run_for(150 * MS);
        let expected = [vec![6, 0, 7, 5, 7], vec![16, 0, 20, 0, 3, 6, 5, 20, 5, 21, 5, 22]];
        assert_eq!(writes(&device), expected, "as their variables are");
    });
}

#[test]
fn between_begin_and_finish_cells_are_only_set_and_then_go_in_one_frame() {
    with_device(|world, rig, device| {
        let lines = "read ramp\nbegin ramp\nwrite ramp at 0 10\nwrite ramp at 2 30\nread ramp\n";
        let said = world.run_until(typed(rig.gateway, lines));
        assert_eq!(said.matches("blocked").count(), 2, "{said}");
        assert!(said.ends_with("a safe write has begun\n"), "{said}");
        world.run_for(5 * SECOND);
        assert_eq!(writes(&device), [[0; 0]; 0]);
        let said = world.run_until(typed(rig.gateway, "finish ramp\n"));
        assert!(said.contains("0802h ok wrote;") && said.contains("[0] 10 1301 30\n"), "{said}");
        assert_eq!(writes(&device), [vec![16, 0, 20, 0, 3, 6, 0, 10, 5, 21, 0, 30]]);
    });
}

#[test]
fn watch_points_shows_status_and_values_as_they_change_until_something_is_typed() {
    with_device(|world, rig, device| {
        let change = async {
            embassy_time::Timer::after(1_550 * MS).await;
            device.memory().holding[40] = 77;
        };
        let parts = [(MS, "watch points\n"), (3 * SECOND, "\n"), (MS, "show devices\n")];
        let (said, ()) =
            world.run_until(embassy_futures::join::join(typed_slowly(rig.gateway, &parts), change));
        assert!(said.starts_with("speed "), "all of them first: {said}");
        assert_eq!(said.matches("limit ").count(), 1, "what does not change is shown once: {said}");
        assert!(said.contains("[0] 1320\n") && said.contains("[0] 77\n"), "{said}");
        assert!(said.contains("meter              5") && said.contains("alive"), "the next command: {said}");
    });
}
