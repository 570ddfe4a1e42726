//! Clients that read the same registers, or neighbouring ones: how many responses a transaction on the bus gives, and whether
//! each is new and its requester's own.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use mobgate_simulator::client::load::Latencies;
use mobgate_simulator::device::Fresh;

use crate::line::{DISCARDS, Speed, TURNAROUND, seconds};
use crate::prelude::*;

const RUN: Duration = Duration::from_secs(60);
const CLIENTS: u8 = 32;
/// Clients that read neighbouring registers, each so many of them.
const NEIGHBOURS: u8 = 8;
const REGISTERS: u8 = 10;
/// Where the device has registers that differ at every read; they are within the ten that are read.
const FRESH: u8 = 100;

/// What the clients saw.
#[derive(Default)]
struct Seen {
    responses: u64,
    /// Responses that the device gave before they were asked for.
    stale: u64,
    /// Exceptions, and responses of another length.
    wrong: u64,
    latencies: Latencies,
}

pub(crate) fn figures() {
    identical();
    adjacent();
}

/// Everybody reads the same.
fn identical() {
    let speed = Speed::new(115_200);
    rig::with_gateway(11, &speed.settings(), |world, rig| {
        let device = Device::new(1).with_turnaround(TURNAROUND).with_fresh(FRESH.into());
        rig.attach(world, "bus", [device.clone()]);
        world.run_for(DISCARDS);
        let seen = Rc::new(RefCell::new(Seen::default()));
        let until = Instant::now() + RUN;
        for host in 1..=CLIENTS {
            let (mut client, seen) = (rig.client(machine(host), 502), seen.clone());
            world.spawn(async move {
                let mut asked = Instant::now();
                let next = || (1, vec![3, 0, FRESH, 0, REGISTERS]);
                let note = |_, pdu: &[u8], response: &_| seen.borrow_mut().note(&mut asked, pdu, response);
                ClosedLoop::until(until).run(&mut client, next, note).await
            });
        }
        world.run_for(RUN);
        let seen = seen.borrow();
        let transactions = device.counters().requests[3] as f64;
        let legal = 1.0 / speed.period();
        figure("merged_answers_per_s", seen.responses as f64 / seconds(RUN), "/s", Target::AtLeast(4_000.0));
        let most = Target::AtMost((legal * 10.0).round() / 10.0);
        figure("merged_bus_rate", transactions / seconds(RUN), "/s", most);
        figure("merged_stale", seen.stale as f64, "responses", Target::AtMost(0.0));
        figure("merged_wrong", seen.wrong as f64, "responses", Target::AtMost(0.0));
        // A request that has just missed a transaction waits for its end and for the next one.
        let p99 = seen.latencies.percentile(99.0).map_or(f64::MAX, seconds);
        figure("merged_p99", p99 / speed.period(), "periods", Target::AtMost(2.0));
        let gap = rig.sent("bus").shortest_gap_ns.unwrap_or(0) as f64 / 1e9;
        figure("merged_shortest_gap", gap / speed.t3_5(), "t3.5", Target::AtLeast(1.0));
    });
}

/// Everybody reads another one of some blocks side by side: whoever asks gets the block behind the one before. All of them move on
/// once a second, so that each client comes by the fresh registers.
fn adjacent() {
    let speed = Speed::new(115_200);
    let [(alone, _), (joined, transactions)] = [" merge off", " merge adjacent"].map(|policy| {
        let settings = speed.settings().trim_end().to_owned() + policy;
        rig::with_gateway(11, &settings, |world, rig| {
            let device = Device::new(1).with_turnaround(TURNAROUND).with_fresh(FRESH.into());
            rig.attach(world, "bus", [device.clone()]);
            world.run_for(DISCARDS);
            let seen = Rc::new(RefCell::new(Seen::default()));
            let asks = Rc::new(Cell::new(0));
            let until = Instant::now() + RUN;
            for host in 1..=NEIGHBOURS {
                let (mut client, seen) = (rig.client(machine(host), 502), seen.clone());
                let asks = asks.clone();
                world.spawn(async move {
                    let mut asked = Instant::now();
                    let next = || {
                        let nth = asks.replace(asks.get() + 1) + Instant::now().as_secs();
                        let block = (nth % u64::from(NEIGHBOURS)) as u8;
                        (1, vec![3, 0, FRESH + REGISTERS * block, 0, REGISTERS])
                    };
                    let note =
                        |_, pdu: &[u8], response: &_| seen.borrow_mut().note(&mut asked, pdu, response);
                    ClosedLoop::until(until).run(&mut client, next, note).await
                });
            }
            world.run_for(RUN);
            let transactions = device.counters().requests[3] as f64 / seconds(RUN);
            let gap = rig.sent("bus").shortest_gap_ns.unwrap_or(0) as f64 / 1e9;
            (seen.take(), (transactions, gap / speed.t3_5()))
        })
    });
    let (transactions, gap) = transactions;
    let rate = |seen: &Seen| seen.responses as f64 / seconds(RUN);
    // One transaction for all is the most that the line can do for them.
    let longest = speed.period_of(NEIGHBOURS * REGISTERS);
    let legal = (f64::from(NEIGHBOURS) / longest).floor();
    figure("unjoined_answers_per_s", rate(&alone), "/s", Target::None);
    figure("joined_answers_per_s", rate(&joined), "/s", Target::AtLeast(legal));
    figure("joined_bus_rate", transactions, "/s", Target::AtMost((10.0 / longest).round() / 10.0));
    figure("joined_gain", rate(&joined) / rate(&alone), "x", Target::AtLeast(2.5));
    figure("joined_stale", joined.stale as f64, "responses", Target::AtMost(0.0));
    figure("joined_wrong", joined.wrong as f64, "responses", Target::AtMost(0.0));
    let p99 = |seen: &Seen| seen.latencies.percentile(99.0).map_or(f64::MAX, seconds);
    figure("joined_p99", p99(&joined) / p99(&alone), "x", Target::AtMost(1.0));
    figure("joined_shortest_gap", gap, "t3.5", Target::AtLeast(1.0));
}

impl Seen {
    /// Looks at the response to `request`, which was asked at `asked`; the next question follows at once.
    fn note(&mut self, asked: &mut Instant, request: &[u8], response: &Response) {
        let now = Instant::now();
        let (Response::Pdu(pdu), [_, _, block, ..]) = (response, request) else { return self.wrong += 1 };
        match fresh(pdu) {
            Some(fresh) if *block == FRESH => {
                self.responses += 1;
                self.stale += u64::from(u64::from(fresh.at_us) < asked.as_micros());
            }
            _ if *block != FRESH && is_block(pdu, *block) => self.responses += 1,
            _ => self.wrong += 1,
        }
        self.latencies.note(now - *asked);
        *asked = now;
    }
}

/// Whether `pdu` has the registers from `first` on, each of which tells its address.
fn is_block(pdu: &[u8], first: u8) -> bool {
    let registers = (first..).take(REGISTERS.into()).flat_map(|address| [1, address]);
    pdu.iter().copied().eq([3, 2 * REGISTERS].into_iter().chain(registers))
}

/// The fresh registers, the first of the ten that were read.
fn fresh(pdu: &[u8]) -> Option<Fresh> {
    let values = pdu.strip_prefix(&[3, 20])?.get(..8)?;
    Fresh::from_response(&[&[3, 8], values].concat())
}
