//! Many transactions, mixed with clients that reset their connections in the middle of requests; then nothing may be missing.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::Instant;

use mobgate_simulator::Random;

use crate::cost::budget;
use crate::figure::{Target, figure};
use crate::{Bus, Machine, Options, wait_for};

/// Clients at a time.
const CLIENTS: u64 = 12;
/// One request in so many is followed by a reset instead of its response.
const RESET_EVERY: usize = 50;
/// Units on each line, and the first of them.
const LINES: [(usize, &str, u8); 3] = [(1, "P1", 1), (2, "P2", 65), (3, "P3", 129)];
const UNITS: u8 = 8;
/// The exception for a device that did not respond.
const NO_RESPONSE: u8 = 0x0b;

/// Of the transactions, those that may be given up.
const GIVEN_UP_SHARE_MAX: f64 = 0.01;

/// Runs `wanted` transactions and prints what came of them.
pub fn run(folder: &Path, wanted: u64) {
    let machine = Machine::start(folder, Options::default());
    let buses = LINES.map(|(uart, _, first)| {
        let bus = Bus::new(first..first + UNITS);
        machine.wire(uart, &bus);
        bus
    });
    let mut console = machine.console();
    let mut figures = machine.figures();
    console.run("clear stats");
    let sockets = figures.sockets_free();

    let answered = AtomicU64::new(0);
    let start = Instant::now();
    let (wrong, given_up) = thread::scope(|scope| {
        let clients: Vec<_> = (0..CLIENTS)
            .map(|seed| {
                let (machine, answered) = (&machine, &answered);
                scope.spawn(move || client(machine, seed, wanted, answered))
            })
            .collect();
        let outcomes = clients.into_iter().map(|client| client.join().unwrap());
        outcomes.fold((0, 0), |sum, outcome| (sum.0 + outcome.0, sum.1 + outcome.1))
    });
    let seconds = start.elapsed().as_secs_f64();

    // Requests whose requesters left are still under way.
    wait_for("the last client to leave", || (console.run("show clients").lines().count() == 1).then_some(()));
    wait_for("every frame to come home", || {
        (console.count("-", "frames-free") == console.count("-", "frames")).then_some(())
    });
    wait_for("every socket to come home", || (figures.sockets_free() >= sockets).then_some(()));
    let answered = answered.into_inner();
    figure("qemu_transactions", answered as f64, "responses", Target::AtLeast(wanted as f64));
    figure("qemu_rate", answered as f64 / seconds, "responses/s", Target::None);
    figure("qemu_wrong_answers", wrong as f64, "responses", Target::AtMost(0.0));
    // Responses of devices that this host kept waiting for longer than the board does.
    let most = GIVEN_UP_SHARE_MAX * wanted as f64;
    figure("qemu_given_up", given_up as f64, "responses", Target::AtMost(most));
    let frames = console.count("-", "frames") - console.count("-", "frames-free");
    figure("qemu_frames_lost", frames as f64, "frames", Target::AtMost(0.0));
    let lost = sockets.abs_diff(figures.sockets_free());
    figure("qemu_sockets_lost", f64::from(lost), "sockets", Target::AtMost(0.0));
    let gap: u64 =
        buses.iter().zip(LINES).map(|(bus, (_, port, _))| unaccounted(&mut console, bus, port)).sum();
    figure("qemu_counters_apart", gap as f64, "requests", Target::AtMost(0.0));
    let most = Target::AtMost(budget("stack"));
    figure("qemu_stack_worst", f64::from(figures.stack_bytes()), "bytes", most);
}

/// How far a line's counters are from what its devices heard, and from each other.
fn unaccounted(console: &mut crate::Console, bus: &Bus, port: &str) -> u64 {
    let [requests, proofs] = ["requests", "proofs"].map(|event| console.count(port, event));
    let ended: u64 =
        ["responses", "timeouts", "corrupt"].iter().map(|event| console.count(port, event)).sum();
    (requests + proofs).abs_diff(bus.requests()) + requests.abs_diff(ended)
}

/// One client after the other until all have got their responses; how many of those were wrong, and how many the board's, for a
/// device that did not respond in time.
fn client(machine: &Machine, seed: u64, wanted: u64, answered: &AtomicU64) -> (u64, u64) {
    let mut random = Random::new(seed);
    let (mut wrong, mut given_up) = (0, 0);
    let mut client = machine.client();
    while answered.load(Ordering::Relaxed) < wanted {
        let (_, _, first) = LINES[random.index(LINES.len())];
        let unit = first + random.index(usize::from(UNITS)) as u8;
        let (address, count) = (random.index(64) as u16, 1 + random.index(8) as u16);
        if random.index(RESET_EVERY) == 0 {
            let _ = client.send(unit, &[3, 0, address as u8, 0, count as u8]);
            client.reset();
            client = machine.client();
            continue;
        }
        let expected: Vec<u8> =
            (address..address + count).flat_map(|address| [unit, address as u8]).collect();
        let request = [3, 0, address as u8, 0, count as u8];
        match client.try_ask(unit, &request) {
            Ok(response) if response.get(2..) == Some(&expected[..]) => {}
            Ok(response) if response == [0x83, NO_RESPONSE] => given_up += 1,
            Ok(response) => {
                eprintln!("unit {unit}, {request:02x?}: {response:02x?} for {expected:02x?}");
                wrong += 1;
            }
            // Nobody but this client ends the connection.
            Err(error) => {
                eprintln!("unit {unit}, {request:02x?}: {error}");
                wrong += 1;
                client = machine.client();
            }
        }
        answered.fetch_add(1, Ordering::Relaxed);
    }
    (wrong, given_up)
}
