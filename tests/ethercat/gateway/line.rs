//! The line of the port, which the MainDevice and the settings can both set: who was last, and that it can be seen.

use mobgate::fieldbus::LineWriter;
use mobgate_simulator::console::typed;

use super::objects::{SETTINGS, read_bytes, write};
use crate::prelude::*;

#[test]
fn whoever_set_the_line_last_wins_and_is_shown() {
    let settings = SETTINGS.replace("port ecat ethercat", "port ecat ethercat line bus");
    with_gateway(1, &settings, |world, rig| {
        let place = rig.gateway.ethercat().unwrap();
        let mut objects = GatewayObjects::new(place);
        let mut set_by = || read_bytes(&mut objects, 0x200a, 0)[0];
        assert_eq!((place.line_writer(), set_by()), (LineWriter::Settings, 0));
        let shown = world.run_until(typed(rig.gateway, "show ports\n"));
        let is_open = shown.lines().any(|row| row.starts_with("bus ") && row.ends_with("19200 8E1    open"));
        assert!(is_open, "{shown}");

        let mut objects = GatewayObjects::new(place);
        for (sub, value) in [(1, 38_400), (2, 0), (3, 0), (4, 1)] {
            write(&mut objects, 0x2020, sub, value).unwrap();
        }
        write(&mut objects, 0x2005, 1, 1).unwrap();
        world.run_for(Duration::from_millis(1));
        assert_eq!(place.line_writer(), LineWriter::MainDevice);
        assert_eq!(read_bytes(&mut objects, 0x200a, 0)[0], 1);
        let shown = world.run_until(typed(rig.gateway, "show ports\nshow config\n"));
        assert!(shown.contains("38400 8N2    open, set by EtherCAT\n"), "{shown}");
        assert!(shown.contains("rtu client 38400 8N2\n"), "{shown}");

        let shown = world.run_until(typed(rig.gateway, "edit port bus 9600 8O1\nshow ports\n"));
        let warning = "warning: the line of the ethercat port: set here, EtherCAT had 38400 8N2\n";
        assert!(shown.starts_with(warning), "{shown}");
        world.run_for(Duration::from_millis(1));
        let shown = world.run_until(typed(rig.gateway, "edit port ecat on-loss hold\nshow ports\n"));
        assert!(!shown.contains("warning"), "it has been said: {shown}");
        assert!(shown.contains("9600 8O1     open, set here, EtherCAT had 38400 8N2\n"), "{shown}");
        assert_eq!(read_bytes(&mut objects, 0x200a, 0)[0], 0);

        write(&mut objects, 0x2005, 2, 0).unwrap();
        write(&mut objects, 0x2005, 1, 1).unwrap();
        world.run_for(Duration::from_millis(1));
        assert_eq!(place.line_writer(), LineWriter::MainDevice);
    });
}
