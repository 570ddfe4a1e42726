//! What the way through the real program costs: transactions per second and their times on a PTY without pacing, beside a
//! client that is connected to the same kind of PTY directly.
//!
//! ```text
//! TCP clients --> mobgate --> PTY --> responder        direct client --> PTY --> responder
//! ```
//!
//! All are measured in turns, in several rounds, so that whatever else the machine does meets them alike. Each value is
//! printed as `figure NAME VALUE UNIT - ok`: it depends on the machine, and what tells is the ratio.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::thread;
use std::time::{Duration, Instant};

use common::Program;
use line::{ANSWER_BYTES, Line, PDU_BYTES, answer_pdu, request};
use mobgate::modbus::rtu;
use serial2::SerialPort;
use statistics::{Round, figure, median, percentile_us};

#[path = "../../tests/common/mod.rs"]
mod common;
mod line;
mod statistics;

const ROUNDS: usize = 7;
const ROUND: Duration = Duration::from_millis(700);
/// Not measured, at the beginning of each round.
const WARM_UP: Duration = Duration::from_millis(50);
const CLIENTS: [usize; 2] = [1, 8];
/// MBAP header and PDU.
const TCP_ANSWER_BYTES: usize = 7 + PDU_BYTES;

fn main() {
    // Cargo adds `--bench`; what is left are the names of groups, of which this is one.
    let wanted: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with("--")).collect();
    if wanted.is_empty() || wanted.iter().any(|group| group == "pty") {
        measure();
    }
}

fn measure() {
    let mut direct_line = Line::with_responder();
    let gateway_line = Line::with_responder();
    let program = Program::configured(&format!(
        "port P1 serial {} rtu client 115200 8N1 gap 0ms\nport P502 tcp server {{port}}\nroute P502 * * * P1\n",
        gateway_line.device()
    ));
    program.logs("is open");
    let mut streams: Vec<TcpStream> = (0..8).map(|_| program.connect()).collect();

    let mut direct = Vec::new();
    let mut through = CLIENTS.map(|_| Vec::new());
    for _ in 0..ROUNDS {
        direct.push(timed(|until| ask_directly(&mut direct_line.near, until)));
        for (clients, rounds) in CLIENTS.into_iter().zip(&mut through) {
            rounds.push(timed(|until| ask_together(&mut streams[..clients], until)));
        }
    }
    report("direct", &direct);
    for (clients, rounds) in CLIENTS.into_iter().zip(&through) {
        report(&format!("{clients}_clients"), rounds);
        compare(&format!("{clients}_clients"), rounds, &direct);
    }
}

/// Runs `load` for one round.
fn timed(mut load: impl FnMut(Instant) -> Vec<Duration>) -> Round {
    load(Instant::now() + WARM_UP);
    let start = Instant::now();
    let times = load(start + ROUND);
    Round { took: start.elapsed(), times }
}

/// A closed loop at the line itself.
fn ask_directly(line: &mut SerialPort, until: Instant) -> Vec<Duration> {
    let mut answer = [0; ANSWER_BYTES];
    closed_loop(until, |address| {
        let mut frame = [0; rtu::FRAME_BYTES_MAX];
        line.write_all(rtu::encode(1, &request(address), &mut frame).unwrap()).unwrap();
        line.read_exact(&mut answer).unwrap();
        assert_eq!(rtu::decode(&answer), Ok((1, &answer_pdu(address)[..])));
    })
}

/// A closed loop on each of `streams`, all at the same time.
fn ask_together(streams: &mut [TcpStream], until: Instant) -> Vec<Duration> {
    thread::scope(|scope| {
        let clients: Vec<_> = streams
            .iter_mut()
            .zip(1..)
            .map(|(stream, unit)| scope.spawn(move || ask_by_tcp(stream, unit, until)))
            .collect();
        clients.into_iter().flat_map(|client| client.join().unwrap()).collect()
    })
}

fn ask_by_tcp(stream: &mut TcpStream, unit: u8, until: Instant) -> Vec<Duration> {
    let mut answer = [0; TCP_ANSWER_BYTES];
    closed_loop(until, |address| {
        let [high, low] = address.to_be_bytes();
        stream.write_all(&[&[high, low, 0, 0, 0, 6, unit], &request(address)[..]].concat()).unwrap();
        stream.read_exact(&mut answer).unwrap();
        assert_eq!(answer[..7], [high, low, 0, 0, 0, 1 + PDU_BYTES as u8, unit]);
        assert_eq!(answer[7..], answer_pdu(address));
    })
}

/// The times of one transaction after the other, each for another address.
fn closed_loop(until: Instant, mut transact: impl FnMut(u16)) -> Vec<Duration> {
    let mut times = Vec::new();
    let mut address = 0u16;
    while Instant::now() < until {
        let asked = Instant::now();
        transact(address);
        times.push(asked.elapsed());
        address = address.wrapping_add(1);
    }
    times
}

fn report(name: &str, rounds: &[Round]) {
    figure(&format!("pty_rate_{name}"), median(rounds.iter().map(Round::rate)), "/s");
    figure(&format!("pty_p50_{name}"), percentile_us(rounds, 0.50), "us");
    figure(&format!("pty_p99_{name}"), percentile_us(rounds, 0.99), "us");
}

/// Through the gateway over direct, round by round: the median and between what the rounds lie.
fn compare(name: &str, through: &[Round], direct: &[Round]) {
    let pairs = || through.iter().zip(direct);
    let rates: Vec<f64> = pairs().map(|(through, direct)| through.rate() / direct.rate()).collect();
    let p50 = |round: &Round| percentile_us(std::slice::from_ref(round), 0.50);
    let times: Vec<f64> = pairs().map(|(through, direct)| p50(through) / p50(direct)).collect();
    for (what, ratios) in [("rate", rates), ("p50", times)] {
        let name = format!("pty_{what}_ratio_{name}");
        figure(&name, median(ratios.iter().copied()), "x");
        figure(&format!("{name}_lowest"), ratios.iter().copied().fold(f64::MAX, f64::min), "x");
        figure(&format!("{name}_highest"), ratios.iter().copied().fold(0.0, f64::max), "x");
    }
}
