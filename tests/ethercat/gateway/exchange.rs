//! ethercrab configures the gateway and exchanges its process image with Modbus devices: every byte, and in time.

use embassy_time::Duration;
use mobgate::config::LineSettings;
use mobgate_simulator::Random;

use super::bench::{MS, SETUP, Setup, TURNAROUND, with_devices};
use super::virtual_devices::virtual_devices;

#[test]
fn the_four_devices_are_configured_by_sdo_and_every_byte_is_that_of_the_vectors() {
    with_devices(SETUP, async |bench| {
        let group = bench.desk.to_pre_op().await.unwrap();
        assert_eq!(bench.requests(), 0, "there is no traffic before");
        bench.configure(&group).await;
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        assert_eq!(gateway.sdo_read::<u16>(0x2005, 1).await.unwrap(), 0);
        assert_eq!(gateway.sdo_read::<u16>(0x2005, 2).await.unwrap(), 1);
        for (device, index) in bench.virtuals.iter().zip(0x2011..) {
            for (expected, sub) in device.layout.into_iter().zip(1..) {
                assert_eq!(gateway.sdo_read::<u16>(index, sub).await.unwrap(), expected);
            }
        }
        let group = bench.to_op(group, &bench.output_image()).await;
        bench.cycle_for(&group, Duration::from_secs(1)).await;
        let gateway = group.subdevice(bench.desk.master, 0).unwrap();
        let (image, length) = (bench.input_image(), bench.input_image().len());
        assert_eq!(gateway.inputs_raw()[..length], image);
        assert_eq!(gateway.inputs_raw()[length..], vec![0; 120 - length]);
        assert_eq!(bench.writes(), 2 * 4, "each kind of output was written once");
    });
}

/// Bytes that a kind's cells take; the first two kinds are bits.
fn bytes(kind: usize, cells: u16) -> usize {
    usize::from(if kind < 2 { cells.div_ceil(8) } else { 2 * cells })
}

/// The time that each exchange of a round takes on the wire, without the silence behind it: reads of everything, and writes of
/// everything that can be written.
fn exchanges(setup: Setup) -> (Vec<Duration>, Vec<Duration>) {
    let line = LineSettings { baud: setup.baud, ..LineSettings::DEFAULT };
    let time = |chars: usize| line.chars(chars) + 2 * line.t3_5() + TURNAROUND;
    let kinds = virtual_devices().into_iter().flat_map(|device| device.ranges.into_iter().enumerate());
    let kinds: Vec<_> = kinds.map(|(kind, (cells, _))| (kind, bytes(kind, cells))).collect();
    let reads = kinds.iter().map(|(_, bytes)| time(8 + 5 + bytes));
    let writes = kinds.iter().filter(|(kind, _)| matches!(kind, 0 | 3)).map(|(_, bytes)| time(9 + bytes + 8));
    (reads.collect(), writes.collect())
}

fn sum(times: &[Duration]) -> Duration {
    times.iter().fold(Duration::from_ticks(0), |sum, time| sum + *time)
}

/// Within what time a MainDevice must see changes.
pub(crate) struct Limits {
    /// What changes at a device.
    pub(crate) input: Duration,
    /// What it sends itself, until it is read back.
    pub(crate) back: Duration,
}

impl Limits {
    pub(crate) fn of(setup: Setup) -> Self {
        let (reads, writes) = exchanges(setup);
        let most = Duration::from_millis(setup.polling_ms.into()).max(sum(&reads));
        // What changes while it is read is in the answer of the next poll.
        let answer = *reads.iter().max().unwrap();
        // Until the MainDevice sends or fetches, and until the SubDevice has put inputs there: two cycles.
        let slack = Duration::from_millis(2 * setup.cycle_ms);
        // A round to read, the writes that follow it, and a round to read back.
        Self { input: most + answer + slack, back: 2 * most + sum(&writes) + slack }
    }
}

/// Changes values on both sides at random times; every change is seen in time.
fn exchange(setup: Setup) {
    let Limits { input: limit, back } = Limits::of(setup);
    with_devices(setup, async |bench| {
        let group = bench.desk.to_pre_op().await.unwrap();
        bench.configure(&group).await;
        let group = bench.to_op(group, &bench.output_image()).await;
        let image = bench.input_image();
        let seen = bench.cycle_until(&group, back, |inputs| inputs[..image.len()] == image).await;
        assert!(seen.is_some(), "{setup:?}: what is written is read back within {} ms", back.as_millis());

        let mut random = Random::new(setup.baud.into());
        for value in 0..10_u16 {
            bench.cycle_for(&group, MS * random.within(0..=200) as u32).await;
            let nth = random.index(4);
            let (device, layout) = (&bench.virtuals[nth], bench.virtuals[nth].layout);
            let register = usize::from(device.ranges[2].1);
            bench.devices[nth].memory().input[register] = 0x1200 + value;
            let place = usize::from(layout[3]);
            let expected = (0x1200 + value).to_be_bytes();
            let seen = bench.cycle_until(&group, limit, |inputs| inputs[place..place + 2] == expected).await;
            assert!(seen.is_some(), "{setup:?}: an input within {} ms", limit.as_millis());

            let (from, place) = (usize::from(layout[8]), usize::from(layout[4]));
            let mut outputs = bench.output_image();
            outputs[from..from + 2].copy_from_slice(&expected);
            bench.put(&group, &outputs);
            let seen = bench.cycle_until(&group, back, |inputs| inputs[place..place + 2] == expected).await;
            assert!(seen.is_some(), "{setup:?}: read back within {} ms", back.as_millis());
        }
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
    for (baud, polling_ms, cycle_ms) in [
        (4_800, 1, 1),
        (4_800, 1_000, 4),
        (19_200, 1, 4),
        (19_200, 1_000, 1),
        (115_200, 1, 1),
        (115_200, 10, 2),
        (115_200, 1_000, 4),
    ] {
        exchange(Setup { baud, polling_ms, cycle_ms, ..SETUP });
    }
}
