//! The loads on one device: what each measures, and what its figures must be.

use std::time::Duration;

use crate::Effort;
use crate::contestants::{Behind, Contestant, Wired};
use crate::figure::{Target, figure};
use crate::lane::{Lane, contest, contestants};
use crate::line::{Device, EXCEPTION_CHARS, NO_SUCH_ADDRESS, Pace};
use crate::load::Habit;
use crate::statistics::{best_peer, find, median, own, percentile, table};

const BAUDS: [u32; 2] = [115_200, 19_200];
const CLIENTS: [usize; 3] = [1, 8, 32];
/// Longer than any response of a unit that is well, and than what a busy machine delays it by.
const TIMEOUT_MS: u32 = 500;

/// So many clients, each with its own registers.
fn habits(clients: usize) -> Vec<Habit> {
    (0..clients).map(Habit::of).collect()
}

/// A lane for each gateway to a device like `device`.
fn to_lines(device: Device, timeout_ms: u32) -> Vec<Lane> {
    let any = Behind::Line(Wired { device: "", pace: device.pace, timeout_ms });
    contestants(any, |contestant: Contestant| Lane::to_line(contestant, device, timeout_ms))
}

/// The same with a direct client in front.
fn beside_direct(device: Device) -> Vec<Lane> {
    let mut lanes = to_lines(device, TIMEOUT_MS);
    lanes.insert(0, Lane::direct(device));
    lanes
}

/// A line without pacing, and no gap.
pub(crate) fn unpaced(effort: Effort) {
    let mut lanes = beside_direct(Device::UNPACED);
    for clients in [1, 8] {
        contest(&mut lanes, &habits(clients), effort.rounds(7), effort.length(700));
        table(&format!("no pacing, {clients} clients"), &lanes);
        let name = format!("unpaced_{clients}_clients");
        figure(&format!("{name}_over_direct"), own(&lanes).over(&lanes[0]).median, "x", Target::None);
        if let Some(best) = best_peer(&lanes) {
            // Asked for where gateways have something to do: with one client all of them wait for the scheduler.
            let target = if clients == 8 { Target::AtLeast(1.0) } else { Target::None };
            figure(&format!("{name}_over_best_peer"), own(&lanes).over(best).median, "x", target);
        }
    }
}

/// Lines at the pace of a wire.
pub(crate) fn paced(effort: Effort) {
    for baud in BAUDS {
        let mut lanes = beside_direct(Device::paced(baud));
        for clients in CLIENTS {
            contest(&mut lanes, &habits(clients), effort.rounds(5), effort.length(1_500));
            table(&format!("{baud} baud, {clients} clients"), &lanes);
            let (own, name) = (own(&lanes), format!("paced_{baud}_{clients}_clients"));
            // 1.00, to the two decimals in which it is wanted: at 19200 baud 0.1 % are 24 us, the time of one wake-up.
            figure(&format!("{name}_over_direct"), own.over(&lanes[0]).median, "x", Target::AtLeast(0.995));
            figure(&format!("{name}_early"), 100.0 * own.early(), "%", Target::AtMost(0.0));
            figure(&format!("{name}_switches"), own.switches(), "per transaction", Target::AtMost(8.0));
            figure(&format!("{name}_cpu"), own.cpu_us(), "us per transaction", Target::None);
            if let Some(mbusd) = find(&lanes, Contestant::MbusdShortPause.name()) {
                let part = own.cpu_us() / mbusd.cpu_us();
                figure(&format!("{name}_cpu_over_mbusd"), part, "x", Target::AtMost(0.5));
            }
        }
    }
}

/// A device that drops requests that come too early: what part of the requests is answered.
pub(crate) fn strict(effort: Effort) {
    let mut lanes = to_lines(Device { strict: true, ..Device::paced(115_200) }, 50);
    contest(&mut lanes, &habits(8), effort.rounds(3), effort.length(3_000));
    table("115200 baud, a device that drops requests after an illegal gap, 8 clients", &lanes);
    for lane in &lanes {
        let goodput =
            median(lane.rounds.iter().map(|round| round.good() as f64 / round.requests.max(1) as f64));
        let target = if lane.name == "mobgate" { Target::AtLeast(1.0) } else { Target::None };
        figure(&format!("strict_goodput_{}", word(lane.name)), goodput, "x", target);
    }
}

/// How long an exception of the device takes.
pub(crate) fn exceptions(effort: Effort) {
    for baud in BAUDS {
        let device = Device::paced(baud);
        let mut lanes = beside_direct(device);
        let habit =
            Habit { address: NO_SUCH_ADDRESS, step: 0, think: Duration::from_millis(20), ..Habit::of(0) };
        contest(&mut lanes, &[habit], effort.rounds(3), effort.length(2_000));
        table(&format!("{baud} baud, exceptions of the device, 1 client"), &lanes);
        let wire = device.pace.transaction(EXCEPTION_CHARS).as_secs_f64();
        for lane in &lanes {
            // The table tells of those that pass on none.
            if let Some(took) = percentile(lane.times(), 0.5) {
                let name = format!("exception_{baud}_{}", word(lane.name));
                figure(&name, took.as_secs_f64() / wire, "x wire time", Target::None);
            }
        }
    }
}

/// Eight clients, each with its own unit, one of which is dead: what the other seven keep.
pub(crate) fn dead(effort: Effort) {
    const UNITS: usize = 8;
    let device = Device { dead: Some(UNITS as u8), ..Device::paced(115_200) };
    let mut lanes = to_lines(device, 100);
    let rate = |lane: &Lane| {
        median(lane.rounds.iter().map(|round| {
            let good: usize = round.loads[..UNITS - 1].iter().map(|load| load.times.len()).sum();
            good as f64 / round.took.as_secs_f64()
        }))
    };
    contest(&mut lanes, &habits(UNITS - 1), effort.rounds(2), effort.length(3_000));
    let alone: Vec<f64> = lanes.iter().map(rate).collect();
    // Long enough for the first time-outs, which have to be waited for, to be a small part.
    let mut all = habits(UNITS);
    // Who is refused at once must not ask all the time: that would measure who gets the processor.
    all[UNITS - 1].think = Duration::from_millis(1);
    contest(&mut lanes, &all, 1, effort.length(20_000));
    table("115200 baud, one dead unit of eight, 8 clients", &lanes);
    for (lane, alone) in lanes.iter().zip(alone) {
        let target = if lane.name == "mobgate" { Target::AtLeast(95.0) } else { Target::None };
        figure(
            &format!("kept_beside_dead_unit_{}", word(lane.name)),
            100.0 * rate(lane) / alone,
            "%",
            target,
        );
    }
}

/// 32 clients that read the same registers.
pub(crate) fn shared(effort: Effort) {
    let mut lanes = to_lines(Device::paced(115_200), TIMEOUT_MS);
    let same = Habit { step: 0, ..Habit::of(0) };
    contest(&mut lanes, &[same; 32], effort.rounds(3), effort.length(2_000));
    table("115200 baud, 32 clients, the same registers", &lanes);
    for lane in &lanes {
        let target = if lane.name == "mobgate" { Target::AtLeast(4_000.0) } else { Target::None };
        figure(&format!("shared_answers_{}", word(lane.name)), lane.rate(), "/s", target);
    }
}

/// A client that asks now and then, among 31 that ask all the time.
pub(crate) fn polite(effort: Effort) {
    let pace = Pace::of(115_200);
    let mut lanes = to_lines(Device::paced(115_200), TIMEOUT_MS);
    let mut habits = habits(32);
    // Longer than a turn of everybody takes: who asks more often has no more right than the others.
    habits[0].think = Duration::from_millis(307);
    contest(&mut lanes, &habits, effort.rounds(3), effort.length(10_000));
    table("115200 baud, a polite client among 31 flooders", &lanes);
    for lane in &lanes {
        let polite = lane.rounds.iter().flat_map(|round| &round.loads[0].times).copied().collect::<Vec<_>>();
        for (what, part, target) in [("p99", 0.99, Target::AtMost(3.0)), ("worst", 1.0, Target::None)] {
            let Some(waited) = percentile(polite.clone(), part) else { continue };
            let target = if lane.name == "mobgate" { target } else { Target::None };
            let periods = waited.as_secs_f64() / pace.period().as_secs_f64();
            figure(&format!("polite_{what}_{}", word(lane.name)), periods, "periods", target);
        }
    }
}

/// From TCP to a TCP server.
pub(crate) fn tcp(effort: Effort) {
    let mut lanes = contestants(Behind::Tcp(0), Lane::to_tcp);
    for clients in [1, 8, 64] {
        contest(&mut lanes, &habits(clients), effort.rounds(5), effort.length(1_000));
        table(&format!("TCP to TCP, {clients} clients"), &lanes);
        if let Some(best) = best_peer(&lanes) {
            let ratio = own(&lanes).over(best).median;
            figure(&format!("tcp_{clients}_clients_over_best_peer"), ratio, "x", Target::None);
        }
    }
}

/// A lane's name as a part of a figure's.
fn word(name: &str) -> String {
    name.replace(", ", "_").replace([' ', '-'], "_")
}
