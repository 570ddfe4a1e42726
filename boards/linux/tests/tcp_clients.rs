//! The program with rude TCP clients.

use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use common::{Program, ask, wait_for};

mod common;

const READ_METER: [u8; 5] = [4, 0, 0, 0, 1];

#[test]
fn ten_thousand_connections_opened_and_dropped_leave_the_program_as_it_was() {
    let program = Program::demo();
    ask(&mut program.connect(), 1, &READ_METER);
    wait_for("the connections' end", || (program.descriptors() < 24).then_some(()));
    let before = program.descriptors();
    for _ in 0..10_000 {
        drop(TcpStream::connect((Ipv4Addr::LOCALHOST, program.port)).unwrap());
    }
    wait_for("the connections' end", || (program.descriptors() <= before).then_some(()));
    ask(&mut program.connect(), 1, &READ_METER);
}

#[test]
fn without_descriptors_left_connections_wait_and_the_program_does_not_spin() {
    let mut command = Command::new("sh");
    let limited = "ulimit -n 40; exec \"$0\" --socket off --config \"$1\"";
    command.args(["-c", limited, env!("CARGO_BIN_EXE_mobgate")]).stdin(Stdio::null());
    let settings = "port P502 tcp server {port} clients 100\n";
    let program = Program::by(&mut command, settings, &["{folder}/mobgate.conf"]);
    let crowd: Vec<TcpStream> = (0..60).map(|_| program.connect()).collect();
    program.logs("a TCP connection has to wait");
    let before = program.cpu_ticks();
    thread::sleep(Duration::from_secs(2)); // what is measured
    let spent = program.cpu_ticks() - before;
    assert!(spent < 20, "{} ms of processor time in 2 s of waiting", spent * 10);
    drop(crowd);
    // There is no rule, so the response is 0Ah.
    assert_eq!(ask(&mut program.connect(), 1, &READ_METER), [0x84, 0x0a]);
}

#[test]
fn a_client_that_never_reads_stops_nobody_else() {
    let program = Program::configured("port P502 tcp server {port}\nroute P502 1 * * local\n");
    let mut rude = program.connect();
    rude.set_nonblocking(true).unwrap();
    // The gateway's own unit responds at once, with more bytes than it was asked by.
    let requests = [0, 1, 0, 0, 0, 5, 1, 0x2b, 0x0e, 1, 0].repeat(1_000);
    let (mut sent, mut moved) = (0, Instant::now());
    // Until the program stops reading because its responses are not taken.
    while moved.elapsed() < Duration::from_secs(2) {
        // A part of a request may go: what follows is the rest of it.
        match rude.write(&requests[sent % requests.len()..]) {
            Ok(count) => (sent, moved) = (sent + count, Instant::now()),
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                thread::sleep(Duration::from_millis(1)); // it is full
            }
            Err(error) => panic!("after {sent} bytes: {error}"),
        }
    }
    assert!(sent > 0);
    let mut polite = program.connect();
    let asked = Instant::now();
    assert!(ask(&mut polite, 1, &[0x2b, 0x0e, 1, 0]).len() > 4);
    // Then a client is closed that takes no response, and would stop nobody any more.
    assert!(asked.elapsed() < Duration::from_secs(10), "{:?}", asked.elapsed());
}

#[test]
fn half_a_frame_waits_and_a_bad_length_closes_the_connection() {
    let program = Program::demo();
    let mut half = program.connect();
    half.write_all(&[0, 1, 0, 0, 0]).unwrap();
    for length in [0_u16, 1, 255, 65_535] {
        let mut bad = program.connect();
        let [high, low] = length.to_be_bytes();
        bad.write_all(&[0, 1, 0, 0, high, low, 1, 4, 0, 0, 0, 1]).unwrap();
        assert_eq!(bad.read(&mut [0; 16]).unwrap_or(0), 0, "length {length} was answered");
    }
    half.write_all(&[6, 1, 4, 0, 0, 0, 1]).unwrap();
    let mut response = [0; 11];
    half.read_exact(&mut response).unwrap();
    assert_eq!(response[..9], [0, 1, 0, 0, 0, 5, 1, 4, 2]);
}
