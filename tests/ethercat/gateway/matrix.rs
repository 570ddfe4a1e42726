//! How soon a MainDevice sees what changes at the virtual devices, and reads back what it writes, at every speed of the line, polling
//! time and cycle; what it may take follows from the line alone.

use embassy_time::Duration;
use mobgate::settings::LineSettings;
use mobgate_simulator::Random;
use mobgate_simulator::timing::{chars_ns, t3_5_ns};

use super::bench::{MS, SETUP, Setup, TURNAROUND, with_devices};
use super::virtual_devices::virtual_devices;

const BAUDS: [u32; 6] = [4_800, 9_600, 19_200, 38_400, 57_600, 115_200];
const POLLINGS_MS: [u32; 5] = [1, 10, 100, 500, 1_000];
const CYCLES_MS: [u64; 4] = [1, 2, 3, 4];
/// Every speed with every polling time and every cycle.
pub(crate) const COMBINATIONS: u64 = (BAUDS.len() * POLLINGS_MS.len() * CYCLES_MS.len()) as u64;
/// No divisor of their number: so many steps after each other lead through all of them, in great strides.
const STRIDE: u64 = 37;

/// One of the combinations, as far from the next as can be.
pub(crate) fn combination(nth: u64) -> Setup {
    let nth = (nth * STRIDE % COMBINATIONS) as usize;
    let (baud, rest) = (BAUDS[nth % BAUDS.len()], nth / BAUDS.len());
    let polling_ms = POLLINGS_MS[rest % POLLINGS_MS.len()];
    Setup { baud, polling_ms, cycle_ms: CYCLES_MS[rest / POLLINGS_MS.len()], ..SETUP }
}

/// Bytes that a kind's cells take; the first two kinds are bits.
fn bytes(kind: usize, cells: u16) -> usize {
    usize::from(if kind < 2 { cells.div_ceil(8) } else { 2 * cells })
}

/// The time that each exchange of a round takes on the wire, without the silence behind it: reads of everything, and writes of
/// everything that can be written.
pub(crate) fn exchanges(setup: Setup) -> (Vec<Duration>, Vec<Duration>) {
    let line = LineSettings { baud: setup.baud, ..LineSettings::DEFAULT };
    let time =
        |chars: usize| Duration::from_nanos(chars_ns(&line, chars as u64) + 2 * t3_5_ns(&line)) + TURNAROUND;
    let kinds = virtual_devices().into_iter().flat_map(|device| device.ranges.into_iter().enumerate());
    let kinds: Vec<_> = kinds.map(|(kind, (cells, _))| (kind, bytes(kind, cells))).collect();
    let reads = kinds.iter().map(|(_, bytes)| time(8 + 5 + bytes));
    let writes = kinds.iter().filter(|(kind, _)| matches!(kind, 0 | 3)).map(|(_, bytes)| time(9 + bytes + 8));
    (reads.collect(), writes.collect())
}

pub(crate) fn sum(times: &[Duration]) -> Duration {
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
        // What changes while it is read is in the response of the next poll.
        let response = *reads.iter().max().unwrap();
        // Until the MainDevice sends or fetches, and until the SubDevice has put inputs there: two cycles.
        let slack = Duration::from_millis(2 * setup.cycle_ms);
        // A round to read, the writes that follow it, and a round to read back.
        Self { input: most + response + slack, back: 2 * most + sum(&writes) + slack }
    }
}

/// The longest times, each as a part of what it may take: 1 is all of it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Longest {
    pub(crate) input: f64,
    pub(crate) back: f64,
}

/// Changes values on both sides at random times.
pub(crate) fn exchange(setup: Setup) -> Longest {
    let Limits { input: limit, back } = Limits::of(setup);
    let mut longest = Longest::default();
    let part = |seen: Option<Duration>, limit: Duration, what: &str| {
        let seen = seen.unwrap_or_else(|| panic!("{setup:?}: {what} within {} ms", limit.as_millis()));
        seen.as_micros() as f64 / limit.as_micros() as f64
    };
    with_devices(setup, async |bench| {
        let group = bench.dispatcher.to_pre_op().await.unwrap();
        bench.configure(&group).await;
        let group = bench.to_op(group, &bench.output_image()).await;
        let image = bench.input_image();
        let seen = bench.cycle_until(&group, back, |inputs| inputs[..image.len()] == image).await;
        longest.back = part(seen, back, "a read-back of everything");

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
            longest.input = longest.input.max(part(seen, limit, "an input"));

            let (from, place) = (usize::from(layout[8]), usize::from(layout[4]));
            let mut outputs = bench.output_image();
            outputs[from..from + 2].copy_from_slice(&expected);
            bench.put(&group, &outputs);
            let seen = bench.cycle_until(&group, back, |inputs| inputs[place..place + 2] == expected).await;
            longest.back = longest.back.max(part(seen, back, "a read-back"));
        }
    });
    longest
}
