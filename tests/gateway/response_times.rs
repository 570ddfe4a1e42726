//! Percentiles of response times from a few bytes.

use mobgate::gateway::response_times::ResponseTimes;
use mobgate::gateway::unit_health::Unit;

use crate::prelude::*;

/// How far a percentile may be off: the width of a class.
const OFF: f64 = 0.6;

#[test]
fn percentiles_are_near_those_of_all_the_responses() {
    let mut random = Random::new(1);
    for longest in [3_000, 40_000, 900_000] {
        let mut times = ResponseTimes::new();
        let mut all: Vec<u32> = (0..200).map(|_| random.within(longest / 3..=longest) as u32).collect();
        all.iter().for_each(|took| times.add(*took));
        all.sort_unstable();
        for percent in [50, 90, 99] {
            let exact = f64::from(all[all.len() * percent / 100]);
            let told = f64::from(times.percentile(percent as u32).unwrap());
            assert!((told / exact - 1.0).abs() < OFF, "{percent} %: {told}, not {exact}");
        }
    }
}

#[test]
fn old_responses_fade_and_rare_slow_ones_are_seen() {
    let mut times = ResponseTimes::new();
    assert_eq!(times.percentile(50), None);
    (0..10_000).for_each(|_| times.add(300_000));
    assert!(times.percentile(50).unwrap() > 200_000);
    (0..2_000).for_each(|_| times.add(3_000));
    assert!(times.percentile(50).unwrap() < 3_200);
    times.add(5_000_000);
    assert_eq!(times.percentile(100), Some(2_048_000), "more than the scale has");
}

#[test]
fn the_units_of_a_port_take_little_memory() {
    // 20 bytes of times and 20 of errors for each.
    assert!(size_of::<Unit>() <= 120, "{}", size_of::<Unit>());
    // Those of an RS-485 segment.
    assert!(32 * (size_of::<ResponseTimes>() + 20) <= 1_280);
}
