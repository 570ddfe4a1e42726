//! How far the other lines of a board shift a line's time when all of them are at their legal rate: counted while they are, for what
//! comes from TCP, and for frames that are passed on from line to line while they arrive.
//!
//! The emulated processor does an instruction in 64 ns, a chip one in a cycle or so. When the other lines are asked as much less often
//! as it is slower, the same share of its instructions is theirs, and the line waits for as many instructions as on the chip.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{scope, sleep};
use std::time::{Duration, Instant};

use mobgate::settings::LineSettings;
use mobgate_simulator::Random;
use mobgate_simulator::timing::{chars_ns, t3_5_ns};

use crate::cost::INSTRUCTIONS_PER_TICK;
use crate::figure::{Target, figure};
use crate::passing::Passing;
use crate::{Bus, Client, Machine, Options};

/// The processors of the STM32 boards.
const CHIPS: [(&str, f64); 3] = [("h743", 400e6), ("f767", 216e6), ("f429", 168e6)];
const EMULATED_HZ: f64 = 1e9 / 64.0;
/// A line of 115200 baud has a read of ten registers in each of these, and a board so many lines more.
const PERIOD_SECONDS: f64 = 0.007_652;
const OTHER_LINES: f64 = 3.0;
/// A unit on the line that is watched, and one on each of those that stand for the others.
const WATCHED: u8 = 1;
const UNITS: [u8; 2] = [65, 129];
/// Times that a line needs the processor for a transaction: a request comes, it leaves, its response comes, that leaves. The
/// third one is measured.
const NEEDS: f64 = 4.0;
/// Transactions of the line that is watched, and the longest pause between two.
const TRANSACTIONS: u32 = 500;
const PAUSE_US: u64 = 30_000;
/// Most that the others may shift it, in percent.
const SHIFT_MAX: f64 = 1.0;
/// Attempts at a measurement on a busy host.
const ATTEMPTS: u32 = 5;
/// Reads that are passed on, of so many registers, and the speeds and registers for which their times are told.
const PASSED_ON: u32 = 150;
const FEW_REGISTERS: u8 = 1;
const BAUDS: [u32; 3] = [9_600, 19_200, 115_200];
const REGISTERS: [u8; 3] = [1, 10, 125];
/// Characters of a read and of its response without the registers' own, and the time that the device takes.
const READ_CHARACTERS: u64 = 8 + 5;
const TURNAROUND_SECONDS: f64 = 0.001;
/// How many times as long as alone a transaction may take that is passed on.
const LOADED_MAX: f64 = 1.01;

/// Prints how far; `instructions` are those of a transaction.
pub fn figures(folder: &Path, instructions: f64) {
    let machine = Machine::start(folder, Options { counts_instructions: true, ..Options::default() });
    for (uart, unit) in (1..).zip([WATCHED].into_iter().chain(UNITS)) {
        machine.wire(uart, &Bus::new([unit]));
    }
    let mut figures = machine.figures();
    let mut waits_once = |units: &[u8], chip: Option<f64>| {
        let (mut watched, mut random) = (machine.client(), Random::new(1));
        figures.waits();
        beside(&machine, units, chip, || {
            for _ in 0..TRANSACTIONS {
                sleep(Duration::from_micros(random.within(0..=PAUSE_US)));
                read(&mut watched, WATCHED);
            }
        });
        Waits::of(figures.waits(), TRANSACTIONS)
    };
    let mut waits = |units: &[u8], chip| on_a_quiet_host(|| waits_once(units, chip));
    let alone = waits(&[], None);
    for (chip, clock_hz) in CHIPS {
        let loaded = waits(&UNITS, Some(clock_hz));
        let shift = NEEDS * (loaded.mean - alone.mean) / clock_hz / PERIOD_SECONDS;
        figure(&format!("other_ports_shift_{chip}"), 100.0 * shift, "%", Target::AtMost(SHIFT_MAX));
        let worst = (loaded.most - alone.mean) / clock_hz;
        figure(&format!("other_ports_longest_wait_{chip}"), 1e6 * worst, "us", Target::None);
        let share = OTHER_LINES * instructions / clock_hz / PERIOD_SECONDS;
        figure(&format!("other_ports_work_{chip}"), 100.0 * share, "%", Target::None);
    }
}

/// Prints how much longer a transaction takes that is passed on from line to line.
pub fn passed_on(folder: &Path) {
    let machine = Machine::start(folder, Options { counts_instructions: true, ..Options::default() });
    machine.wire(1, &Bus::new([WATCHED]));
    let mut passing = Passing::start(&machine, &mut machine.console());
    let mut figures = machine.figures();
    let mut waits_once = |units: &[u8], chip: Option<f64>| {
        let mut random = Random::new(1);
        figures.passed();
        beside(&machine, units, chip, || {
            for _ in 0..PASSED_ON {
                sleep(Duration::from_micros(random.within(0..=PAUSE_US)));
                passing.read(FEW_REGISTERS);
            }
        });
        Waits::of(figures.passed(), 2 * PASSED_ON)
    };
    let mut waits = |units: &[u8], chip| on_a_quiet_host(|| waits_once(units, chip));
    let alone = waits(&[], None);
    for (chip, clock_hz) in CHIPS {
        let loaded = waits(&[WATCHED], Some(clock_hz));
        // The copy of a request begins so much later, and that of its response.
        let later = 2.0 * (loaded.mean - alone.mean) / clock_hz;
        for baud in BAUDS {
            for registers in REGISTERS {
                let factor = 1.0 + later / alone_seconds(baud, registers);
                let name = format!("cut_loaded_{chip}_{baud}_{registers}");
                figure(&name, factor, "x", Target::AtMost(LOADED_MAX));
            }
        }
        let worst = (loaded.most - alone.mean) / clock_hz;
        figure(&format!("cut_loaded_longest_wait_{chip}"), 1e6 * worst, "us", Target::None);
    }
}

/// What a read takes at least that is not shifted: as long as without a gateway.
fn alone_seconds(baud: u32, registers: u8) -> f64 {
    let line = LineSettings { baud, ..LineSettings::DEFAULT };
    let characters = READ_CHARACTERS + 2 * u64::from(registers);
    (chars_ns(&line, characters) + t3_5_ns(&line)) as f64 / 1e9 + TURNAROUND_SECONDS
}

/// Instructions from an interrupt until what it woke a task for was done.
struct Waits {
    mean: f64,
    most: f64,
}

impl Waits {
    /// The board's sums of what was to happen so many times, or what it was instead. Where this host is busy, some bytes are there
    /// before anybody waits: a few do not matter.
    fn of([total, times, longest]: [u32; 3], wanted: u32) -> Result<Self, String> {
        if f64::from(times) < 0.9 * f64::from(wanted) {
            return Err(format!("{times} waits instead of {wanted}"));
        }
        let instructions = |ticks: u32| f64::from(ticks) * INSTRUCTIONS_PER_TICK;
        Ok(Self { mean: instructions(total) / f64::from(times), most: instructions(longest) })
    }
}

/// Measures again, a few times, where the host was too busy.
fn on_a_quiet_host(mut measure: impl FnMut() -> Result<Waits, String>) -> Waits {
    let mut last = measure();
    for _ in 1..ATTEMPTS {
        last = last.or_else(|_| measure());
    }
    last.unwrap_or_else(|why| panic!("this host is too busy: {why}"))
}

/// Does `act` while `units` stand for the other lines of a board whose processor has so many cycles a second.
fn beside(machine: &Machine, units: &[u8], clock_hz: Option<f64>, act: impl FnOnce()) {
    let slower = clock_hz.map_or(0.0, |clock_hz| clock_hz / EMULATED_HZ);
    let period = Duration::from_secs_f64(PERIOD_SECONDS * slower * units.len() as f64 / OTHER_LINES);
    let begun = Instant::now();
    let over = AtomicBool::new(false);
    let others: u32 = scope(|scope| {
        let others: Vec<_> = units
            .iter()
            .map(|&unit| {
                let (mut client, over) = (machine.client(), &over);
                scope.spawn(move || load(&mut client, unit, period, over))
            })
            .collect();
        act();
        over.store(true, Ordering::Relaxed);
        others.into_iter().map(|other| other.join().unwrap()).sum()
    });
    if !units.is_empty() {
        let wanted = units.len() as f64 * begun.elapsed().as_secs_f64() / period.as_secs_f64();
        let is_fair = f64::from(others) >= 0.9 * wanted;
        assert!(is_fair, "the others had {others} transactions instead of {wanted}");
    }
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
    let response = client.read(unit, 0, 10);
    assert_eq!(response.len(), 22, "unit {unit}: {response:02x?}");
}
