//! Rounds of measurement and what is printed of them.

use std::time::Duration;

/// What one round brought.
pub(crate) struct Round {
    pub(crate) took: Duration,
    /// Of each transaction.
    pub(crate) times: Vec<Duration>,
}

impl Round {
    /// Transactions per second.
    pub(crate) fn rate(&self) -> f64 {
        self.times.len() as f64 / self.took.as_secs_f64()
    }
}

/// The time that `part` of all transactions did not exceed, in microseconds.
pub(crate) fn percentile_us(rounds: &[Round], part: f64) -> f64 {
    let mut times: Vec<Duration> = rounds.iter().flat_map(|round| &round.times).copied().collect();
    times.sort_unstable();
    let rank = (times.len() as f64 * part).ceil() as usize;
    times[rank.max(1) - 1].as_secs_f64() * 1e6
}

/// The value in the middle.
pub(crate) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Prints a value that has no target.
pub(crate) fn figure(name: &str, value: f64, unit: &str) {
    println!("figure {name} {} {unit} - ok", (value * 1e4).round() / 1e4);
}
