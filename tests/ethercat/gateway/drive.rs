//! The drive test: values that a MainDevice writes to a drive again and again come back in time, hour after hour.
//!
//! `MOBGATE_SEED=17 cargo test drive` runs the hours of seed 17 alone; `cargo bench -- drive` runs thirty days.

use embassy_time::Duration;
use mobgate_simulator::drive::{LONGEST, drive};
use mobgate_simulator::random::each_seed;

const SEEDS: u64 = 4;
const HOUR: Duration = Duration::from_secs(60 * 60);
/// Of each seed, before a value: so that it comes at any moment of the polling.
const PAUSE: Duration = Duration::from_secs(2);

#[test]
fn every_value_of_some_hours_is_read_back_within_three_seconds_and_was_written_once() {
    each_seed(SEEDS, |seed| {
        let outcome = drive(seed, HOUR, PAUSE, |_| {});
        assert_eq!(outcome.errors, 0, "seed {seed}: {outcome:?}");
        assert!(outcome.worst <= LONGEST && outcome.values > 1_000, "seed {seed}: {outcome:?}");
    });
}
