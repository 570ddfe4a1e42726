//! The drive test: values that a MainDevice writes to a drive again and again come back in time, hour after hour, and under all
//! conditions that there are in the industry.
//!
//! `MOBGATE_SEED=17 cargo test drive` runs the hours of seed 17 alone; `cargo xtask bench drive` runs thirty days.

use mobgate_simulator::drive::{Conditions, drive};

use crate::prelude::*;

const SEEDS: u64 = 4;
const HOUR: Duration = Duration::from_secs(60 * 60);
/// Of each seed, before a value: so that it comes at any moment of the polling.
const PAUSE: Duration = Duration::from_secs(2);

#[test]
fn every_value_of_some_hours_is_read_back_within_three_seconds_and_was_written_once() {
    each_seed(SEEDS, |seed| {
        let outcome = drive(Conditions::USUAL, seed, HOUR, PAUSE, |_| {});
        assert_eq!(outcome.errors, 0, "seed {seed}: {outcome:?}");
        let is_good = outcome.worst <= Duration::from_secs(3) && outcome.values > 1_000;
        assert!(is_good, "seed {seed}: {outcome:?}");
    });
}

#[test]
fn values_are_read_back_within_their_polling_times_at_any_speed_of_line_and_cycle() {
    let bauds = [4_800, 9_600, 19_200, 38_400];
    let cycles = [100, 250, 500, 1_000].map(Duration::from_micros);
    let pollings = [1, 10, 100, 1_000, 2_000];
    // A quarter of all: each of two with each of the third. `MOBGATE_SEEDS=80` drives under all.
    each_seed(20, |seed| {
        let nth = seed as usize;
        let (baud, polling) = (nth % 4, nth / 4 % 5);
        let conditions = Conditions {
            baud: bauds[baud],
            polling_ms: pollings[polling],
            cycle: cycles[(baud + polling + nth / 20) % 4],
        };
        let outcome = drive(conditions, seed, conditions.longest() * 10, conditions.longest(), |_| {});
        assert_eq!(outcome.errors, 0, "{conditions:?}: {outcome:?}");
        assert!(outcome.values >= 5, "{conditions:?}: {outcome:?}");
    });
}
