//! Several saturated lines of one gateway: whether they carry as much together as each for itself, and beside one that is at fault.

use mobgate_simulator::fault::babble;

use crate::line::{Speed, TURNAROUND, read, seconds};
use crate::prelude::*;

const RUN: Duration = Duration::from_secs(60);
const LINES: u8 = 4;
/// Clients of each line.
const CLIENTS: u8 = 8;
/// Of its legal rate, what a line must carry to count as saturated, and what one that is at fault may still carry.
const SATURATED: f64 = 0.97;
const DISTURBED: f64 = 0.2;
/// Of a client whose line is at fault, before it asks again.
const THOUGHT: Duration = Duration::from_millis(1);
/// Bytes of noise at a time, and what is between them.
const NOISE_BYTES: usize = 5;
const NOISE_PAUSE: Duration = Duration::from_millis(20);

pub(crate) fn figures() {
    for baud in [9_600, 19_200, 115_200] {
        let legal = seconds(RUN) / Speed::new(baud).period();
        let all = carried(baud, LINES, None);
        let are_busy = all.iter().all(|carried| *carried >= SATURATED * legal);
        assert!(are_busy, "lines of {baud} baud are idle: {all:?}");
        let ratio = sum(&all) / sum(&carried(baud, 1, None));
        figure(&format!("ports_{LINES}_over_1_{baud}"), ratio, "x", Target::AtLeast(3.98));
        for fault in [LineFault::Dead, LineFault::Babbling, LineFault::Noise] {
            let beside = carried(baud, LINES, Some(fault));
            let mut shares = beside.iter().zip(&all).map(|(beside, alone)| beside / alone);
            let disturbed = shares.next_back().unwrap_or(1.0);
            assert!(disturbed <= DISTURBED, "{fault:?} leaves its line {disturbed} at {baud} baud");
            // The line that suffers most.
            let share = shares.fold(1.0, f64::min);
            let name = format!("beside_{fault:?}_port_{baud}").to_lowercase();
            figure(&name, 100.0 * share, "%", Target::AtLeast(95.0));
        }
    }
}

/// What is wrong with the last line.
#[derive(Debug, Clone, Copy)]
enum LineFault {
    /// Its device does not respond.
    Dead,
    /// Somebody on it never stops sending.
    Babbling,
    /// There are a few random bytes on it, again and again.
    Noise,
}

fn sum(carried: &[f64]) -> f64 {
    carried.iter().sum()
}

/// Transactions on each line, when so many of them are busy.
fn carried(baud: u32, busy: u8, fault: Option<LineFault>) -> Vec<f64> {
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
        let last = format!("bus{LINES}");
        let noise =
            |pause| babble(rig.wire(&last).tap(rig.end(&last).line()), Random::new(17), NOISE_BYTES, pause);
        match fault {
            None => {}
            Some(LineFault::Dead) => {
                devices[usize::from(LINES) - 1].set_faults(Faults::new(17).with(When::Always, Fault::Dead));
            }
            Some(LineFault::Babbling) => drop(world.spawn(noise(Duration::from_ticks(0)))),
            Some(LineFault::Noise) => drop(world.spawn(noise(NOISE_PAUSE))),
        }
        let until = Instant::now() + RUN;
        for host in 1..=busy * CLIENTS {
            let mut client = rig.client(machine(host), 502);
            let unit = 1 + (host - 1) / CLIENTS;
            // Who is refused at once would ask again at once, and time stood still.
            let patience = if fault.is_some() && unit == LINES { THOUGHT } else { Duration::from_ticks(0) };
            let load = ClosedLoop::until(until).thinking(patience);
            world.spawn(
                async move { load.run(&mut client, || (unit, read(host).to_vec()), |_, _, _| {}).await },
            );
        }
        world.run_for(RUN);
        if let Some(LineFault::Babbling) = fault {
            assert!(seconds(rig.wire(&last).busy()) >= 0.99 * seconds(RUN), "somebody sends all the time");
        }
        devices.iter().map(|device| device.counters().requests[3] as f64).collect()
    })
}
