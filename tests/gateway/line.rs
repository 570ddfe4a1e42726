//! A TCP server in front of a serial client, in virtual time.

use mobgate_simulator::client::Answer;
use mobgate_simulator::rig::machine;
use mobgate_simulator::{Device, rig};

const SETTINGS: &str = "
port P1 serial bus rtu client 19200 8E1
port P502 tcp server 502
route P502 * * * P1
";

#[test]
fn a_register_is_read_through_the_gateway() {
    rig::with_gateway(1, SETTINGS, |world, rig| {
        let device = Device::new(5);
        device.memory().holding[7] = 0xcafe;
        rig.attach(world, "bus", [device]);
        let mut client = rig.client(machine(1), 502);
        let answer = world.run_until(client.request(5, &[3, 0, 7, 0, 1]));
        assert_eq!(answer, Answer::Pdu(vec![3, 2, 0xca, 0xfe]));
        assert_eq!(rig.frames_in_use(), 0);
    });
}
