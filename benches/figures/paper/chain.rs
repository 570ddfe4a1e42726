//! Chains of routers in virtual time, and how long transactions through them take.

use mobgate::stats::Event;
use mobgate_simulator::Master;

use super::formula::Line;
use super::{TURNAROUND, UNIT};
use crate::prelude::*;

const TRANSACTIONS: u32 = 50;

pub(super) fn read(registers: u8) -> [u8; 5] {
    [3, 0, 0, 0, registers]
}

/// What was seen of many transactions.
pub(super) struct Seen {
    /// From the request's first bit to the response's last one, in seconds.
    pub(super) worst: f64,
    /// Frames with a gap inside that a device would not have taken.
    pub(super) gaps: u32,
}

/// The worst transaction without a router.
pub(super) fn alone(line: Line, registers: u8) -> f64 {
    rig::with_gateway(1, &format!("port C {}\n", line.port("bus", "client")), |world, rig| {
        rig.attach(world, "bus", [Device::new(UNIT).with_turnaround(turnaround())]);
        let mut master = rig.master("bus");
        world.run_for(Duration::from_millis(100));
        measure(world, rig, [("bus", line); 2], registers, &mut master)
    })
}

/// The worst transaction through routers on these lines.
pub(super) fn through(lines: &[Line], registers: u8, rule: &str) -> Seen {
    chain(lines, rule, |world, rig, _| {
        let mut master = rig.master("w0@0");
        let last = lines.len() - 1;
        let ends = [("w0@0", lines[0]), (&format!("w{last}@{last}"), lines[last])];
        let worst = measure(world, rig, ends, registers, &mut master);
        let cut = if rule.is_empty() { TRANSACTIONS } else { 0 };
        assert_eq!(rig.counted("C1", Event::Cut), cut, "passed on as the rule says");
        let gaps = lines.iter().enumerate().map(|(hop, line)| split(rig, hop, *line, registers)).sum();
        Seen { worst, gaps }
    })
}

/// Frames on the line `hop` that were not whole when the first silence over t1.5 came in them, as sent by the gateway.
fn split(rig: &Rig<'_>, hop: usize, line: Line, registers: u8) -> u32 {
    let device = format!("w{hop}@{hop}");
    let wanted = line.chars(registers).map(|chars| chars as usize);
    let frames = rig.wire(&device).frames();
    frames.iter().filter(|frame| !wanted.contains(&frame.bytes.len())).count() as u32
}

/// A chain of routers, each on two lines, with a device behind the last one.
pub(super) fn chain<T>(
    lines: &[Line],
    rule: &str,
    scenario: impl for<'w> FnOnce(&mut World<'w>, &Rig<'w>, &Device) -> T,
) -> T {
    let mut settings = String::new();
    for hop in 1..lines.len() {
        let (up, down) = (hop - 1, hop);
        let side = if hop + 1 < lines.len() { "c" } else { "" };
        settings += &format!(
            "port S{hop} {}\nport C{hop} {}\nroute S{hop} * * * C{hop} {rule}\n",
            lines[up].port(&format!("w{up}@{up}"), "server"),
            lines[down].port(&format!("w{down}@{down}{side}"), "client"),
        );
    }
    rig::with_gateway(1, &settings, |world, rig| {
        let device = Device::new(UNIT).with_turnaround(turnaround());
        let last = lines.len() - 1;
        rig.attach(world, &format!("w{last}@{last}"), [device.clone()]);
        world.run_for(Duration::from_millis(100));
        scenario(world, rig, &device)
    })
}

fn turnaround() -> Duration {
    Duration::from_micros((TURNAROUND * 1e6) as u64)
}

/// Asks many times, and looks at the first wire for how long that takes at most, in seconds. The device behind the last one
/// hears the silence and counts its turnaround in whole ticks of the clock: what it takes too long is not counted.
fn measure(
    world: &mut World<'_>,
    rig: &Rig<'_>,
    [(first, _), (last, line)]: [(&str, Line); 2],
    registers: u8,
    master: &mut Master,
) -> f64 {
    let mut random = Random::new(u64::from(registers));
    for _ in 0..TRANSACTIONS {
        // At any moment, later than t3.5 after the last transaction on every line.
        let pause = Duration::from_micros(random.within(20_000..=50_000));
        let response = world.run_until(async {
            Timer::after(pause).await;
            master.request(UNIT, &read(registers)).await
        });
        assert!(matches!(response, Response::Pdu(_)), "{response:?}");
    }
    let seconds = |from_ns: u64, to_ns: u64| (to_ns - from_ns) as f64 / 1e9;
    let device = line.device();
    let (asked, answered) = (rig.wire(first).frames(), rig.wire(last).frames());
    let pairs = asked.chunks_exact(2).zip(answered.chunks_exact(2));
    let took = pairs.map(|(requester, responder)| {
        let late = seconds(responder[0].end_ns, responder[1].start_ns) - device;
        seconds(requester[0].start_ns, requester[1].end_ns) - late
    });
    took.fold(0.0, f64::max)
}
