//! How far the other lines of a board shift a line's time when all of them are at their legal rate: counted while they are.
//!
//! The emulated processor does an instruction in 64 ns, a chip one in a cycle or so. When the other lines are asked as much less often
//! as it is slower, the same share of its instructions is theirs, and the line waits for as many instructions as on the chip.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{scope, sleep};
use std::time::{Duration, Instant};

use mobgate_simulator::Random;

use crate::cost::INSTRUCTIONS_PER_TICK;
use crate::figure::{Target, figure};
use crate::{Bus, Client, Figures, Machine, Options};

/// The processors of the STM32 boards.
const CHIPS: [(&str, f64); 3] = [("h743", 400e6), ("f767", 216e6), ("f429", 168e6)];
const EMULATED_HZ: f64 = 1e9 / 64.0;
/// A line of 115200 baud has a read of ten registers in each of these, and a board so many lines more.
const PERIOD_SECONDS: f64 = 0.007_652;
const OTHER_LINES: f64 = 3.0;
/// A unit on the line that is watched, and one on each of those that stand for the others.
const WATCHED: u8 = 1;
const UNITS: [u8; 2] = [65, 129];
/// Times that a line needs the processor for a transaction: a request comes, it leaves, its answer comes, that leaves. The
/// third one is measured.
const NEEDS: f64 = 4.0;
/// Transactions of the line that is watched, and the longest pause between two.
const TRANSACTIONS: u32 = 500;
const PAUSE_US: u64 = 30_000;
/// Most that the others may shift it, in percent.
const SHIFT_MAX: f64 = 1.0;

/// Prints how far; `instructions` are those of a transaction.
pub fn figures(folder: &Path, instructions: f64) {
    let machine = Machine::start(folder, Options { counts_instructions: true, ..Options::default() });
    for (uart, unit) in (1..).zip([WATCHED].into_iter().chain(UNITS)) {
        machine.wire(uart, &Bus::new([unit]));
    }
    let mut figures = machine.figures();
    let alone = waits(&machine, &mut figures, None);
    for (chip, clock_hz) in CHIPS {
        let period = PERIOD_SECONDS * clock_hz / EMULATED_HZ * UNITS.len() as f64 / OTHER_LINES;
        let loaded = waits(&machine, &mut figures, Some(Duration::from_secs_f64(period)));
        let shift = NEEDS * (loaded.mean - alone.mean) / clock_hz / PERIOD_SECONDS;
        figure(&format!("other_ports_shift_{chip}"), 100.0 * shift, "%", Target::AtMost(SHIFT_MAX));
        let worst = (loaded.most - alone.mean) / clock_hz;
        figure(&format!("other_ports_longest_wait_{chip}"), 1e6 * worst, "us", Target::None);
        let share = OTHER_LINES * instructions / clock_hz / PERIOD_SECONDS;
        figure(&format!("other_ports_work_{chip}"), 100.0 * share, "%", Target::None);
    }
}

/// Instructions from a line's interrupt until its task had read.
struct Waits {
    mean: f64,
    most: f64,
}

/// Those of the first line while each of the others has a transaction in each `period`, or none.
fn waits(machine: &Machine, figures: &mut Figures, period: Option<Duration>) -> Waits {
    let mut watched = machine.client();
    figures.waits();
    let begun = Instant::now();
    let over = AtomicBool::new(false);
    let others: u32 = scope(|scope| {
        let others = period.map(|period| {
            UNITS.map(|unit| {
                let (mut client, over) = (machine.client(), &over);
                scope.spawn(move || load(&mut client, unit, period, over))
            })
        });
        let mut random = Random::new(1);
        for _ in 0..TRANSACTIONS {
            sleep(Duration::from_micros(random.within(0..=PAUSE_US)));
            read(&mut watched, WATCHED);
        }
        over.store(true, Ordering::Relaxed);
        others.into_iter().flatten().map(|other| other.join().unwrap()).sum()
    });
    if let Some(period) = period {
        let wanted = UNITS.len() as f64 * begun.elapsed().as_secs_f64() / period.as_secs_f64();
        assert!(
            f64::from(others) >= 0.9 * wanted,
            "the others had {others} transactions instead of {wanted}"
        );
    }
    let [waited, times, longest] = figures.waits().map(|count| f64::from(count) * INSTRUCTIONS_PER_TICK);
    let times = times / INSTRUCTIONS_PER_TICK;
    assert!(times >= f64::from(TRANSACTIONS), "each answer is waited for: {times}");
    Waits { mean: waited / times, most: longest }
}

/// A transaction in each `period`, at any moment of it, until it is `over`; how many there were.
fn load(client: &mut Client, unit: u8, period: Duration, over: &AtomicBool) -> u32 {
    let mut random = Random::new(unit.into());
    let start = Instant::now();
    let mut count = 0;
    while !over.load(Ordering::Relaxed) {
        let moment = random.within(0..=period.as_micros() as u64);
        sleep((period * count + Duration::from_micros(moment)).saturating_sub(start.elapsed()));
        read(client, unit);
        count += 1;
    }
    count
}

fn read(client: &mut Client, unit: u8) {
    let answer = client.read(unit, 0, 10);
    assert_eq!(answer.len(), 22, "unit {unit}: {answer:02x?}");
}
