//! What is printed of the lanes' rounds: a table for people, and what figures are made of.

use std::time::Duration;

use crate::lane::{Lane, Round};

/// The time that `part` of all did not exceed, if there are any.
pub(crate) fn percentile(mut times: Vec<Duration>, part: f64) -> Option<Duration> {
    times.sort_unstable();
    let rank = (times.len() as f64 * part).ceil() as usize;
    times.get(rank.max(1) - 1).copied()
}

/// The value in the middle; not a number when there is none.
pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_unstable_by(f64::total_cmp);
    let at = |rank: usize| values.get(rank).copied().unwrap_or(f64::NAN);
    (at(values.len().saturating_sub(1) / 2) + at(values.len() / 2)) / 2.0
}

/// A value for each round: the one in the middle, and between what the rounds lie.
#[derive(Clone, Copy)]
pub(crate) struct Spread {
    pub(crate) median: f64,
    lowest: f64,
    highest: f64,
}

impl Spread {
    pub(crate) fn of(values: Vec<f64>) -> Self {
        Self {
            lowest: values.iter().copied().fold(f64::INFINITY, f64::min),
            highest: values.iter().copied().fold(0.0, f64::max),
            median: median(values),
        }
    }
}

impl std::fmt::Display for Spread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(&format!("{:.3} ({:.3}-{:.3})", self.median, self.lowest, self.highest))
    }
}

impl Lane {
    /// Good responses per second.
    pub(crate) fn rate(&self) -> f64 {
        median(self.rounds.iter().map(Round::rate))
    }

    /// Its rate over that of `other`, round by round.
    pub(crate) fn over(&self, other: &Self) -> Spread {
        let pairs = self.rounds.iter().zip(&other.rounds);
        Spread::of(pairs.map(|(own, other)| own.rate() / other.rate()).collect())
    }

    /// The times of all good responses.
    pub(crate) fn times(&self) -> Vec<Duration> {
        self.rounds.iter().flat_map(|round| &round.loads).flat_map(|load| &load.times).copied().collect()
    }

    /// Processor time for each transaction at the device, or each good response where the device does not count.
    pub(crate) fn cpu_us(&self) -> f64 {
        median(self.rounds.iter().map(|round| round.usage.cpu.as_secs_f64() * 1e6 / round.transactions()))
    }

    /// Context switches for each transaction.
    pub(crate) fn switches(&self) -> f64 {
        median(self.rounds.iter().map(|round| round.usage.switches as f64 / round.transactions()))
    }

    /// Requests at the device that came too early, of all.
    pub(crate) fn early(&self) -> f64 {
        let sum = |count: fn(&Round) -> u64| self.rounds.iter().map(count).sum::<u64>() as f64;
        sum(|round| round.early) / sum(|round| round.requests).max(1.0)
    }
}

impl Round {
    fn transactions(&self) -> f64 {
        let count = if self.requests > 0 { self.requests } else { self.good() as u64 };
        count.max(1) as f64
    }
}

/// Prints a table: one row for each lane, with its ratio to the first one.
pub(crate) fn table(what: &str, lanes: &[Lane]) {
    println!("\n{what}");
    println!(
        "  {:18}{:>9}  {:24}{:>9}{:>9}{:>9}{:>9}{:>9}  not answered well",
        "", "per s", "x first row (rounds)", "p50 us", "p99 us", "CPU us", "switches", "early"
    );
    for lane in lanes {
        let us = |part| percentile(lane.times(), part).map_or(f64::NAN, |time| time.as_secs_f64() * 1e6);
        let sum = |count: fn(&Round) -> u64| lane.rounds.iter().map(count).sum::<u64>();
        println!(
            "  {:18}{:>9.1}  {:24}{:>9.0}{:>9.0}{:>9.0}{:>9.1}{:>8.1}%  {} refused, {} wrong, {} lost",
            lane.name,
            lane.rate(),
            lane.over(&lanes[0]),
            us(0.50),
            us(0.99),
            lane.cpu_us(),
            lane.switches(),
            100.0 * lane.early(),
            sum(|round| round.load().refused),
            sum(|round| round.load().wrong),
            sum(|round| round.load().lost),
        );
    }
}

/// The lane of that name.
pub(crate) fn find<'l>(lanes: &'l [Lane], name: &str) -> Option<&'l Lane> {
    lanes.iter().find(|lane| lane.name == name)
}

/// mobgate's lane. It always takes part: where it does not even start, nothing is to be said.
pub(crate) fn own(lanes: &[Lane]) -> &Lane {
    find(lanes, "mobgate").expect("mobgate takes part")
}

/// The best rate of all other gateways, with its owner; none when mobgate is alone.
pub(crate) fn best_peer(lanes: &[Lane]) -> Option<&Lane> {
    let peers = lanes.iter().filter(|lane| !["mobgate", "direct"].contains(&lane.name));
    peers.max_by(|left, right| left.rate().total_cmp(&right.rate()))
}
