//! What clients and units do to each other: a dead unit beside a healthy one, a polite client among flooders.

use mobgate_simulator::client::load::{Latencies, Load};
use mobgate_simulator::world::Task;

use crate::line::{Speed, read, seconds};
use crate::prelude::*;

const FLOODERS: u8 = 31;
const ASKED: usize = 300;

pub(crate) fn figures() {
    beside_a_dead_unit();
    for (flood, depth) in [("closed", 1), ("pipelined", 16)] {
        among_flooders("polite", "", flood, depth, 3.0);
        among_flooders("high", "route P502 * 10.0.0.200 * P1 priority high\n", flood, depth, 2.0);
    }
}

/// Throughput of a healthy unit while another client polls a dead one, against its throughput alone.
fn beside_a_dead_unit() {
    const RUN: Duration = Duration::from_secs(600);
    let throughput = |with_dead: bool| {
        rig::with_gateway(3, &Speed::new(19_200).settings(), |world, rig| {
            let healthy = Device::new(1);
            rig.attach(world, "bus", [healthy.clone()]);
            poll(world, rig, 1, 1, RUN, Duration::from_ticks(0));
            if with_dead {
                // A unit that is down fails at once: without a pause virtual time would stand still.
                poll(world, rig, 2, 99, RUN, Duration::from_millis(1));
            }
            world.run_for(RUN);
            healthy.counters().requests[3] as f64
        })
    };
    let kept = 100.0 * throughput(true) / throughput(false);
    figure("healthy_beside_dead_unit", kept, "%", Target::AtLeast(95.0));
}

fn poll<'w>(
    world: &World<'w>,
    rig: &Rig<'w>,
    host: u8,
    unit: u8,
    run: Duration,
    think: Duration,
) -> Task<Load> {
    let mut client = rig.client(machine(host), 502);
    let until = Instant::now() + run;
    world.spawn(async move {
        ClosedLoop::until(until)
            .thinking(think)
            .run(&mut client, || (unit, read(host).to_vec()), |_, _, _| {})
            .await
    })
}

/// The 99th percentile of a client that asks every few seconds, while others keep `depth` requests open each.
fn among_flooders(name: &str, rule: &str, flood: &str, depth: usize, periods: f64) {
    for baud in [9_600, 19_200, 115_200] {
        let speed = Speed::new(baud);
        let settings = speed.settings().replace("route", &format!("{rule}route"));
        rig::with_gateway(5, &settings, |world, rig| {
            let device = Device::new(1);
            rig.attach(world, "bus", [device.clone()]);
            for host in 1..=FLOODERS {
                world.spawn(keep_open(rig.client(machine(host), 502), host, depth));
            }
            // Until every flooder has had its turn, nobody has been served longer ago than a newcomer.
            world.run_for(Duration::from_secs(10));
            let begin = Instant::now();
            let start = device.counters().all_requests();
            let (latencies, responses) = world.run_until(ask_now_and_then(rig.client(machine(200), 502)));
            let served = (device.counters().all_requests() - start) as f64;
            assert_eq!(responses, ASKED, "responses without exception");
            let p99 = latencies.percentile(99.0).map_or(f64::MAX, seconds);
            let name = format!("{name}_p99_{baud}_{flood}_flood");
            figure(&name, p99 / speed.period(), "periods", Target::AtMost(periods));
            // The flood must have kept the line busy meanwhile.
            let legal = seconds(Instant::now() - begin) / speed.period();
            figure(&format!("{name}_line_rate"), 100.0 * served / legal, "%", Target::AtLeast(97.0));
        });
    }
}

/// Asks [`ASKED`] times with random pauses; how long the responses took, and how many were no exceptions.
async fn ask_now_and_then(mut client: Client) -> (Latencies, usize) {
    let mut random = Random::new(21);
    let (mut latencies, mut responses) = (Latencies::default(), 0);
    for _ in 0..ASKED {
        Timer::after_micros(random.within(2_500_000..=3_500_000)).await;
        let asked = Instant::now();
        let response = client.request(1, &read(0)).await;
        latencies.note(asked.elapsed());
        responses += usize::from(matches!(response, Response::Pdu(_)) && response.exception().is_none());
    }
    (latencies, responses)
}

/// Keeps `depth` requests open, for ever. No two of all that are open are for the same registers.
async fn keep_open(mut client: Client, host: u8, depth: usize) {
    let mut requests = (0..depth as u8).cycle().map(|nth| [3, host, 10 * nth, 0, 10]);
    let mut next = move || requests.next().unwrap_or(read(host));
    for _ in 0..depth {
        client.send(1, &next()).await;
    }
    loop {
        match client.receive().await {
            Ok(_) => {}
            Err(_) => Timer::after_millis(1).await,
        }
        client.send(1, &next()).await;
    }
}
