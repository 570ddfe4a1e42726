//! ethercrab configures the gateway and exchanges its process image with Modbus devices: every byte, and in time.

use std::collections::HashSet;

use super::bench::{SETUP, Setup, with_devices};
use super::matrix::{COMBINATIONS, combination, exchange, exchanges, sum};
use crate::prelude::*;

#[test]
fn the_four_devices_are_configured_by_sdo_and_every_byte_is_that_of_the_vectors() {
    with_devices(SETUP, async |bench| {
        let group = bench.dispatcher.to_pre_op().await.unwrap();
        assert_eq!(bench.requests(), 0, "there is no traffic before");
        bench.configure(&group).await;
        let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
        assert_eq!(gateway.sdo_read::<u16>(0x2005, 1).await.unwrap(), 0);
        assert_eq!(gateway.sdo_read::<u16>(0x2005, 2).await.unwrap(), 1);
        for (device, index) in bench.virtuals.iter().zip(0x2011..) {
            for (expected, sub) in device.layout.into_iter().zip(1..) {
                assert_eq!(gateway.sdo_read::<u16>(index, sub).await.unwrap(), expected);
            }
        }
        let group = bench.to_op(group, &bench.output_image()).await;
        bench.cycle_for(&group, Duration::from_secs(1)).await;
        let gateway = group.subdevice(bench.dispatcher.master, 0).unwrap();
        let (image, length) = (bench.input_image(), bench.input_image().len());
        assert_eq!(gateway.inputs_raw()[..length], image);
        assert_eq!(gateway.inputs_raw()[length..], vec![0; 120 - length]);
        assert_eq!(bench.writes(), 2 * 4, "each kind of output was written once");
    });
}

#[test]
fn a_round_takes_the_time_that_the_source_measured() {
    let round = |baud| sum(&exchanges(Setup { baud, ..SETUP }).0).as_millis();
    assert_eq!(round(4_800), 937);
    assert!((95..=105).contains(&round(115_200)));
}

#[test]
fn changes_are_seen_within_the_polling_time_or_a_round_and_read_back_a_round_later() {
    // `MOBGATE_SEEDS=120` is every combination; `cargo xtask bench ethercat` prints their figures.
    each_seed(8, |seed| {
        exchange(combination(seed));
    });
}

#[test]
fn all_speeds_polling_times_and_cycles_are_combined() {
    let all: HashSet<_> = (0..COMBINATIONS)
        .map(|nth| {
            let Setup { baud, polling_ms, cycle_ms, .. } = combination(nth);
            (baud, polling_ms, cycle_ms)
        })
        .collect();
    assert_eq!(all.len() as u64, COMBINATIONS);
    for corner in [(4_800, 1, 1), (4_800, 1_000, 4), (115_200, 1, 1), (115_200, 1_000, 4)] {
        assert!(all.contains(&corner));
    }
}
