//! Clients that read the same registers: how many answers a transaction on the bus gives, and whether each is new.

use std::cell::RefCell;
use std::rc::Rc;

use embassy_time::{Duration, Instant};
use mobgate_simulator::client::Answer;
use mobgate_simulator::client::load::{ClosedLoop, Latencies};
use mobgate_simulator::device::Fresh;
use mobgate_simulator::rig::machine;
use mobgate_simulator::{Device, rig};

use crate::line::{Speed, TURNAROUND, seconds};
use crate::{Target, figure};

const RUN: Duration = Duration::from_secs(60);
const CLIENTS: u8 = 32;
/// Where the device has registers that differ at every read; they are within the ten that are read.
const FRESH: u8 = 100;

/// What the clients saw.
#[derive(Default)]
struct Seen {
    answers: u64,
    /// Answers that the device gave before they were asked for.
    stale: u64,
    /// Exceptions, and answers of another length.
    wrong: u64,
    latencies: Latencies,
}

pub(crate) fn figures() {
    let speed = Speed::new(115_200);
    rig::with_gateway(11, &speed.settings(), |world, rig| {
        let device = Device::new(1).with_turnaround(TURNAROUND).with_fresh(FRESH.into());
        rig.attach(world, "bus", [device.clone()]);
        let seen = Rc::new(RefCell::new(Seen::default()));
        let until = Instant::now() + RUN;
        for host in 1..=CLIENTS {
            let (mut client, seen) = (rig.client(machine(host), 502), seen.clone());
            world.spawn(async move {
                let mut asked = Instant::now();
                let next = || (1, vec![3, 0, FRESH, 0, 10]);
                let note = |_, _: &[u8], answer: &_| seen.borrow_mut().note(&mut asked, answer);
                ClosedLoop::until(until).run(&mut client, next, note).await
            });
        }
        world.run_for(RUN);
        let seen = seen.borrow();
        let transactions = device.counters().requests[3] as f64;
        let legal = 1.0 / speed.period();
        figure("merged_answers_per_s", seen.answers as f64 / seconds(RUN), "/s", Target::AtLeast(4_000.0));
        figure(
            "merged_bus_rate",
            transactions / seconds(RUN),
            "/s",
            Target::AtMost((legal * 10.0).round() / 10.0),
        );
        figure("merged_stale", seen.stale as f64, "answers", Target::AtMost(0.0));
        figure("merged_wrong", seen.wrong as f64, "answers", Target::AtMost(0.0));
        // A request that has just missed a transaction waits for its end and for the next one.
        let p99 = seen.latencies.percentile(99.0).map_or(f64::MAX, seconds);
        figure("merged_p99", p99 / speed.period(), "periods", Target::AtMost(2.0));
        let gap = rig.sent("bus").shortest_gap_ns.unwrap_or(0) as f64 / 1e9;
        figure("merged_shortest_gap", gap / speed.t3_5(), "t3.5", Target::AtLeast(1.0));
    });
}

impl Seen {
    /// Looks at the answer to what was asked at `asked`; the next question follows at once.
    fn note(&mut self, asked: &mut Instant, answer: &Answer) {
        let now = Instant::now();
        let fresh = if let Answer::Pdu(pdu) = answer { fresh(pdu) } else { None };
        match fresh {
            Some(fresh) => {
                self.answers += 1;
                self.stale += u64::from(u64::from(fresh.at_us) < asked.as_micros());
            }
            None => self.wrong += 1,
        }
        self.latencies.note(now - *asked);
        *asked = now;
    }
}

/// The fresh registers, the first of the ten that were read.
fn fresh(pdu: &[u8]) -> Option<Fresh> {
    let values = pdu.strip_prefix(&[3, 20])?.get(..8)?;
    Fresh::from_answer(&[&[3, 8], values].concat())
}
