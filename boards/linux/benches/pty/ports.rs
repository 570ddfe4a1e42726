//! Several lines of one gateway at the same time: whether they carry as much together as each for itself, and what the load of
//! others does to the time of a transaction.

use std::time::{Duration, Instant};

use crate::Effort;
use crate::common::{Program, wait_for};
use crate::figure::{Target, figure};
use crate::line::{Device, Line};
use crate::load::{Client, Habit, Load, ask_together};
use crate::statistics::{median, percentile};

const LINES: usize = 4;
/// Clients of each line.
const CLIENTS: usize = 8;
const BAUD: u32 = 115_200;

/// A gateway with some lines, and clients for all of them.
struct Gateway {
    _lines: Vec<Line>,
    _program: Program,
    /// Those of the first line first.
    clients: Vec<Client>,
    habits: Vec<Habit>,
}

impl Gateway {
    fn start() -> Self {
        let lines: Vec<Line> = (0..LINES).map(|_| Line::with(Device::paced(BAUD))).collect();
        let port = |(nth, line): (usize, &Line)| {
            let (first, last) = (units(nth), units(nth + 1) - 1);
            let device = line.device();
            format!(
                "port P{nth} serial {device} rtu client {BAUD} 8N2\nroute P502 {first}-{last} * * P{nth}\n"
            )
        };
        let ports: String = lines.iter().enumerate().map(port).collect();
        let program = Program::configured(&format!("port P502 tcp server {{port}} clients 64\n{ports}"));
        wait_for("the lines", || (program.log().matches("is open").count() == LINES).then_some(()));
        let clients = (0..LINES * CLIENTS).map(|_| Client::connect(program.port).unwrap()).collect();
        let habit = |nth: usize| Habit { unit: units(nth / CLIENTS), ..Habit::of(nth % CLIENTS) };
        Self { _lines: lines, _program: program, clients, habits: (0..LINES * CLIENTS).map(habit).collect() }
    }

    /// The good responses per second of the clients from `first` on, up to `end`.
    fn rate(&mut self, first: usize, end: usize, length: Duration) -> f64 {
        let start = Instant::now();
        let loads = ask_together(&mut self.clients[first..end], &self.habits[first..end], start + length);
        let took = loads.iter().filter_map(|load| load.last).max().map_or(length, |last| last - start);
        loads.iter().map(|load| load.times.len()).sum::<usize>() as f64 / took.as_secs_f64()
    }

    /// The median time of the first client's transactions, beside those from `first` on.
    fn time(&mut self, first: usize, length: Duration) -> f64 {
        let (polled, others) = self.clients.split_at_mut(CLIENTS);
        let until = Instant::now() + length;
        let habits = &self.habits;
        let others = &mut others[first - CLIENTS..];
        let load: Vec<Load> = std::thread::scope(|scope| {
            let busy = scope.spawn(move || ask_together(others, &habits[first..], until));
            let load = ask_together(&mut polled[..1], &habits[..1], until);
            busy.join().unwrap();
            load
        });
        let times = load.into_iter().flat_map(|load| load.times).collect();
        percentile(times, 0.5).map_or(f64::NAN, |time| time.as_secs_f64())
    }
}

/// The first unit of the line `nth`.
fn units(nth: usize) -> u8 {
    10 * nth as u8 + 1
}

pub(crate) fn figures(effort: Effort) {
    let mut gateway = Gateway::start();
    let everybody = LINES * CLIENTS;
    gateway.rate(0, everybody, effort.length(200));
    let (mut carried, mut shifted) = (Vec::new(), Vec::new());
    for _ in 0..effort.rounds(7) {
        let one = gateway.rate(0, CLIENTS, effort.length(1_500));
        carried.push(gateway.rate(0, everybody, effort.length(1_500)) / one);
        let alone = gateway.time(everybody, effort.length(1_500));
        shifted.push(100.0 * (gateway.time(CLIENTS, effort.length(1_500)) / alone - 1.0));
    }
    figure("ports_4_over_1", median(carried), "x", Target::AtLeast(3.9));
    figure("ports_shift_by_others", median(shifted), "%", Target::AtMost(1.0));
}
