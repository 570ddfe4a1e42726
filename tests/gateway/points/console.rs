//! Points that are watched at the console of a gateway with a device on its line; the other commands are in
//! tests/scenarios/point_commands.yaml.

use mobgate_simulator::console::typed_slowly;

use crate::prelude::*;

const SETTINGS: &str = "port bus serial uart1 rtu client 19200 8E1
    port scan scanner
    route scan 5 * * bus
    device meter unit 5
    point speed meter holding 0 count 2 read manual
    point limit meter holding 7 read manual
    point live meter holding 40 read high";

#[test]
fn watch_points_shows_status_and_values_as_they_change_until_something_is_typed() {
    with_gateway(1, SETTINGS, |world, rig| {
        let device = Device::new(5);
        rig.attach(world, "uart1", [device.clone()]);
        world.run_for(SECOND);
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
