//! A TCP server in front of a serial client, in virtual time.

use crate::prelude::*;

const SETTINGS: &str = "
port P1 serial bus rtu client 19200 8E1
port P502 tcp server 502
route P502 * * * P1
";

#[test]
fn who_asks_while_the_line_is_opened_for_the_first_time_waits_for_that() {
    let opening = Duration::from_millis(100);
    let settings = format!("{SETTINGS}edit port P1 late-window 1ms");
    rig::with_gateway_of(Size { opening, ..Size::default() }, 1, &settings, |world, rig| {
        rig.attach(world, "bus", [Device::new(5)]);
        assert_eq!(rig.ask(world, 5, &[3, 0, 7, 0, 1]), Response::Pdu(vec![3, 2, 5, 7]));
        assert!(Instant::now() > Instant::MIN + opening);
    });
}
