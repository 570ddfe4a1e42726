//! A long run on a line whose device is strict: two frames with less than t3.5 between them it takes for one, which is corrupt.
//! Every request must be answered, and none may come too early.

use crate::line::{Speed, TURNAROUND, read, seconds};
use crate::prelude::*;

const CLIENTS: u8 = 8;

const TRANSACTIONS: u32 = 1_000_000;

pub(crate) fn figures() {
    let speed = Speed::new(115_200);
    rig::with_gateway(13, &speed.settings(), |world, rig| {
        let device = Device::new(1).with_turnaround(TURNAROUND);
        rig.attach(world, "bus", [device.clone()]);
        // A little longer than that many take.
        let length = Duration::from_micros((1.01e6 * f64::from(TRANSACTIONS) * speed.period()) as u64);
        let until = Instant::now() + length;
        let clients: Vec<_> = (1..=CLIENTS)
            .map(|host| {
                let mut client = rig.client(machine(host), 502);
                world.spawn(async move {
                    ClosedLoop::until(until).run(&mut client, || (1, read(host).to_vec()), |_, _, _| {}).await
                })
            })
            .collect();
        let good: u64 = clients.into_iter().map(|client| world.run_until(client).responses).sum();
        let counters = device.counters();
        let sent = rig.sent("bus");
        figure("strict_requests", sent.frames as f64, "requests", Target::AtLeast(TRANSACTIONS.into()));
        figure("strict_goodput", good as f64 / sent.frames as f64, "x", Target::AtLeast(1.0));
        figure("strict_damaged", counters.bad_crc as f64, "frames", Target::AtMost(0.0));
        let gap = sent.shortest_gap_ns.unwrap_or(0) as f64 / 1e9;
        figure("strict_shortest_gap", gap / speed.t3_5(), "t3.5", Target::AtLeast(1.0));
        let legal = seconds(length) / speed.period();
        figure("strict_line_rate", 100.0 * sent.frames as f64 / legal, "%", Target::AtLeast(97.0));
    });
}
