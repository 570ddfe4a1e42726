//! Devices behind Modbus TCP and RTU over TCP.

use std::net::SocketAddr;

use embassy_time::{Duration, Instant};
use mobgate_simulator::client::Answer;
use mobgate_simulator::device::Fresh;
use mobgate_simulator::fault::When;
use mobgate_simulator::net::Path;
use mobgate_simulator::rig::{Rig, machine, with_gateway};
use mobgate_simulator::{Device, Fault, Faults, World};

use mobgate::stats::Event;

const PLC: &str = "10.0.1.1:502";
const READ: [u8; 5] = [3, 0, 7, 0, 1];

fn plc() -> SocketAddr {
    PLC.parse().unwrap()
}

fn settings(words: &str) -> String {
    format!(
        "port plc tcp client {PLC} {words}
         port P502 tcp server 502
         route P502 * * * plc"
    )
}

fn ask(world: &mut World<'_>, rig: &Rig<'_>, unit: u8, pdu: &[u8]) -> (Answer, Duration) {
    let mut client = rig.client(machine(1), 502);
    let asked = Instant::now();
    let answer = world.run_until(client.request(unit, pdu));
    (answer, asked.elapsed())
}

#[test]
fn a_request_reaches_a_device_behind_tcp_and_its_answer_comes_back() {
    for words in ["", "idle 0", "in-flight 16", "rtu"] {
        with_gateway(1, &settings(words), |world, rig| {
            let device = Device::new(5);
            match words {
                "rtu" => rig.attach_rtu_over_tcp(world, PLC, [device.clone()]),
                _ => rig.attach_tcp(world, PLC, [device.clone()]),
            }
            world.run_for(Duration::from_secs(2));
            assert_eq!(ask(world, rig, 5, &READ), (Answer::Pdu(vec![3, 2, 5, 7]), Duration::from_millis(1)));
            let (answer, _) = ask(world, rig, 5, &[6, 0, 1, 0, 9]);
            assert_eq!(answer, Answer::Pdu(vec![6, 0, 1, 0, 9]));
            assert_eq!(device.writes().len(), 1);
            assert_eq!(ask(world, rig, 5, &[3, 0xff, 0xff, 0, 1]).0.exception(), Some(2));
            assert_eq!(rig.network.counters().made, 1, "one connection for all");
            world.run_for(Duration::from_secs(10));
            assert_eq!(rig.frames_in_use(), 0);
        });
    }
}
