//! Several saturated lines of one gateway: whether they carry as much together as each for itself.

use embassy_time::{Duration, Instant};
use mobgate_simulator::client::load::ClosedLoop;
use mobgate_simulator::rig::machine;
use mobgate_simulator::{Device, rig};

use crate::line::{TURNAROUND, read};
use crate::{Target, figure};

const RUN: Duration = Duration::from_secs(60);
const LINES: u8 = 4;
/// Clients of each line.
const CLIENTS: u8 = 8;

pub(crate) fn figures() {
    for baud in [9_600, 19_200, 115_200] {
        let ratio = carried(baud, LINES) / carried(baud, 1);
        figure(&format!("ports_{LINES}_over_1_{baud}"), ratio, "x", Target::AtLeast(3.98));
    }
}

/// Transactions on all lines together, when so many of them are busy.
fn carried(baud: u32, busy: u8) -> f64 {
    let line =
        |nth| format!("port P{nth} serial bus{nth} rtu client {baud} 8E1\nroute P502 {nth} * * P{nth}\n");
    let lines: String = (1..=LINES).map(line).collect();
    let settings = format!("port P502 tcp server 502 clients 64\n{lines}");
    rig::with_gateway(17, &settings, |world, rig| {
        let devices: Vec<Device> = (1..=LINES)
            .map(|unit| {
                let device = Device::new(unit).with_turnaround(TURNAROUND);
                rig.attach(world, &format!("bus{unit}"), [device.clone()]);
                device
            })
            .collect();
        let until = Instant::now() + RUN;
        for host in 1..=busy * CLIENTS {
            let mut client = rig.client(machine(host), 502);
            let unit = 1 + (host - 1) / CLIENTS;
            world.spawn(async move {
                ClosedLoop::until(until).run(&mut client, || (unit, read(host).to_vec()), |_, _, _| {}).await
            });
        }
        world.run_for(RUN);
        devices.iter().map(|device| device.counters().requests[3] as f64).sum()
    })
}
