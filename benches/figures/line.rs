//! How much of a line's legal rate the gateway reaches, and what it adds to a transaction.

use mobgate::settings::LineSettings;
use mobgate_simulator::timing::{char_bits, t3_5_ns};

use crate::prelude::*;

const BAUDS: [u32; 3] = [9_600, 19_200, 115_200];
/// The device responds so long after it has seen t3.5 of silence.
pub(crate) const TURNAROUND: Duration = Duration::from_millis(1);
/// A line that was opened asks nobody for `late-window`.
pub(crate) const DISCARDS: Duration = Duration::from_secs(1);
/// FC 3 of ten registers.
const READ: [u8; 5] = read(0);
const REQUEST_CHARS: usize = 8;
const RESPONSE_CHARS: usize = 25;
const EXCEPTION_CHARS: usize = 5;

/// FC 3 of the `nth` ten registers. Clients that ask for different ones cannot share a transaction.
pub(crate) const fn read(nth: u8) -> [u8; 5] {
    [3, nth, 0, 0, 10]
}

/// A line at one speed and everything in front of it.
pub(crate) struct Speed(pub(crate) LineSettings);

impl Speed {
    pub(crate) fn new(baud: u32) -> Self {
        Self(LineSettings { baud, ..LineSettings::DEFAULT })
    }

    pub(crate) fn settings(&self) -> String {
        let baud = self.0.baud;
        format!(
            "port P1 serial bus rtu client {baud} 8E1\nport P502 tcp server 502 clients 64\nroute P502 * * * P1\n"
        )
    }

    /// Request, t3.5, turnaround, and a response of `chars` characters, in seconds.
    fn transaction(&self, chars: usize) -> f64 {
        let bits = (REQUEST_CHARS + chars) as f64 * char_bits(&self.0) as f64;
        bits / f64::from(self.0.baud) + self.t3_5() + seconds(TURNAROUND)
    }

    pub(crate) fn t3_5(&self) -> f64 {
        t3_5_ns(&self.0) as f64 / 1e9
    }

    /// The shortest legal time from one transaction to the next, in seconds.
    pub(crate) fn period(&self) -> f64 {
        self.period_of(10)
    }

    /// The same for reads of so many registers.
    pub(crate) fn period_of(&self, registers: u8) -> f64 {
        self.transaction(EXCEPTION_CHARS + 2 * usize::from(registers)) + self.t3_5()
    }
}

pub(crate) fn seconds(duration: Duration) -> f64 {
    duration.as_micros() as f64 / 1e6
}

pub(crate) fn figures() {
    for baud in BAUDS {
        for clients in [1, 8, 32] {
            rate(&Speed::new(baud), clients);
        }
    }
    BAUDS.into_iter().for_each(|baud| added(&Speed::new(baud)));
    BAUDS.into_iter().for_each(|baud| exception(&Speed::new(baud)));
}

/// Bus transactions per second as a part of the legal rate, and the shortest silence before a request.
fn rate(speed: &Speed, clients: u8) {
    const RUN: Duration = Duration::from_secs(60);
    rig::with_gateway(u64::from(clients), &speed.settings(), |world, rig| {
        let device = Device::new(1).with_turnaround(TURNAROUND);
        rig.attach(world, "bus", [device.clone()]);
        let until = Instant::now() + RUN;
        for host in 1..=clients {
            let mut client = rig.client(machine(host), 502);
            world.spawn(async move {
                ClosedLoop::until(until).run(&mut client, || (1, read(host).to_vec()), |_, _, _| {}).await
            });
        }
        world.run_for(RUN);
        let legal = seconds(RUN) / speed.period();
        let name = format!("line_rate_{}_{clients}_clients", speed.0.baud);
        figure(&name, 100.0 * device.counters().requests[3] as f64 / legal, "%", Target::AtLeast(97.0));
        let gap = rig.sent("bus").shortest_gap_ns.unwrap_or(0) as f64 / 1e9;
        let name = format!("shortest_gap_{}_{clients}_clients", speed.0.baud);
        figure(&name, gap / speed.t3_5(), "t3.5", Target::AtLeast(1.0));
    });
}

/// What the way through the gateway adds to a direct transaction, at the worst of many moments. The clock ticks in
/// microseconds, and each of the four ends of frames is rounded up to a tick.
fn added(speed: &Speed) {
    rig::with_gateway(7, &speed.settings(), |world, rig| {
        rig.attach(world, "bus", [Device::new(1).with_turnaround(TURNAROUND)]);
        let mut random = Random::new(7);
        let mut client = rig.client(machine(1), 502);
        let direct = speed.transaction(RESPONSE_CHARS);
        let mut worst: f64 = 0.0;
        for _ in 0..1_000 {
            // Later than t3.5 after the last transaction, so that nothing has to be waited for.
            let pause = Duration::from_micros(random.within(5_000..=50_000));
            let took = world.run_until(timed(&mut client, pause, &READ));
            worst = worst.max(took - direct);
        }
        figure(&format!("added_latency_{}", speed.0.baud), worst * 1e6, "us", Target::AtMost(4.0));
    });
}

/// An exception of the device, from the request on TCP to the exception on TCP.
fn exception(speed: &Speed) {
    rig::with_gateway(8, &speed.settings(), |world, rig| {
        rig.attach(world, "bus", [Device::new(1).with_turnaround(TURNAROUND)]);
        let mut client = rig.client(machine(1), 502);
        let mut worst: f64 = 0.0;
        for _ in 0..100 {
            // An address that the device does not have.
            let pause = Duration::from_millis(20);
            worst = worst.max(world.run_until(timed(&mut client, pause, &[3, 0xff, 0xf0, 0, 1])));
        }
        let direct = speed.transaction(EXCEPTION_CHARS);
        figure(&format!("exception_{}", speed.0.baud), worst / direct, "x", Target::AtMost(1.02));
    });
}

async fn timed(client: &mut Client, pause: Duration, pdu: &[u8]) -> f64 {
    Timer::after(pause).await;
    let asked = Instant::now();
    let response = client.request(1, pdu).await;
    assert!(matches!(response, Response::Pdu(_)), "{response:?}");
    seconds(asked.elapsed())
}
