//! Many servers behind one TCP client on a few sockets: whether those that are well are polled on time while others are dead.

use mobgate_simulator::net::Path;

use crate::prelude::*;

const STATIONS: u8 = 64;
/// Behind these nobody responds, not even with a refusal.
const DEAD: [u8; 2] = [20, 41];
const SOCKETS: u64 = 8;
const PERIOD: Duration = Duration::from_secs(1);
const RESPONSE: Duration = Duration::from_millis(20);
/// A handshake takes two of these.
const LATENCY: Duration = Duration::from_micros(2_500);
const POLLS: u32 = 600;
const READ: [u8; 5] = [3, 0, 0, 0, 10];

/// When the stations are polled.
#[derive(Clone, Copy)]
enum Polls {
    /// Each at a time of its own.
    Spread,
    /// All at once.
    Together,
}

pub(crate) fn figures() {
    for (name, polls) in [("tcp_stations", Polls::Spread), ("tcp_stations_together", Polls::Together)] {
        let (on_time, worst, sockets) = poll(polls);
        figure(&format!("{name}_on_time"), on_time, "%", Target::AtLeast(99.9));
        figure(&format!("{name}_worst"), worst.as_micros() as f64 / 1e3, "ms", Target::None);
        figure(&format!("{name}_sockets"), sockets as f64, "sockets", Target::AtMost(SOCKETS as f64));
    }
}

fn settings() -> String {
    let servers = (1..=STATIONS).map(|n| format!("server plant unit {n} at 10.0.1.{n}\n"));
    format!(
        "port plant tcp client sockets {SOCKETS}
        port P502 tcp server 502 clients {STATIONS}
        {}route P502 * * * plant",
        servers.collect::<String>()
    )
}

/// The share of the polls of living stations whose responses came before the next poll was due, in per cent; the longest that one
/// took; and the most sockets in use at a time.
fn poll(polls: Polls) -> (f64, Duration, u64) {
    with_gateway(1, &settings(), |world, rig| {
        let mut random = Random::new(7);
        let pollers: Vec<_> = (1..=STATIONS)
            .map(|unit| {
                if !DEAD.contains(&unit) {
                    attach(world, rig, unit);
                } else {
                    rig.network.set_unreachable(format!("10.0.1.{unit}:502").parse().unwrap(), true);
                }
                let phase = match polls {
                    Polls::Spread => Duration::from_micros(random.within(0..=PERIOD.as_micros())),
                    Polls::Together => Duration::from_ticks(0),
                };
                let mut client = rig.client(machine(unit), 502);
                world.spawn(async move {
                    let start = Instant::now() + phase;
                    let (mut on_time, mut worst) = (0, Duration::from_ticks(0));
                    for nth in 0..POLLS {
                        Timer::at(start + PERIOD * nth).await;
                        let response = client.request(unit, &READ).await;
                        let took = (start + PERIOD * nth).elapsed();
                        let is_good =
                            matches!(&response, Response::Pdu(pdu) if pdu.starts_with(&[3, 20, unit]));
                        on_time += u32::from(is_good && took < PERIOD);
                        worst = worst.max(took);
                    }
                    (unit, on_time, worst)
                })
            })
            .collect();
        let (mut on_time, mut worst) = (0, Duration::from_ticks(0));
        for poller in pollers {
            let (unit, good, longest) = world.run_until(poller);
            if !DEAD.contains(&unit) {
                (on_time, worst) = (on_time + good, worst.max(longest));
            }
        }
        let due = (u32::from(STATIONS) - DEAD.len() as u32) * POLLS;
        (f64::from(on_time) / f64::from(due) * 100.0, worst, rig.network.counters().sockets_most)
    })
}

fn attach<'w>(world: &World<'w>, rig: &Rig<'w>, unit: u8) {
    let address = format!("10.0.1.{unit}:502");
    rig.network.set_path(address.parse().unwrap(), Path { latency: LATENCY, ..Path::default() });
    rig.attach_tcp(world, &address, [Device::new(unit).with_turnaround(RESPONSE)]);
}
