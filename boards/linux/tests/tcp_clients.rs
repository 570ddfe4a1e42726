//! The program with rude TCP clients.

use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpStream};
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
fn a_client_that_never_reads_stops_nobody_else() {
    let program = Program::demo();
    let mut rude = program.connect();
    rude.set_nonblocking(true).unwrap();
    // A read of 0 registers is answered at once, by an exception.
    let request = [0, 1, 0, 0, 0, 6, 1, 4, 0, 0, 0, 0];
    let start = Instant::now();
    let mut sent = 0;
    // Until the program stops reading because its answers are not taken.
    while start.elapsed() < Duration::from_secs(3) {
        match rude.write(&request) {
            Ok(count) => sent += count,
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                std::thread::sleep(Duration::from_millis(1)); // it is full
            }
            Err(error) => panic!("{error}"),
        }
    }
    assert!(sent > 0);
    let mut polite = program.connect();
    let asked = Instant::now();
    assert_eq!(ask(&mut polite, 1, &READ_METER).len(), 4);
    assert!(asked.elapsed() < Duration::from_secs(2), "{:?}", asked.elapsed());
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
    let mut answer = [0; 11];
    half.read_exact(&mut answer).unwrap();
    assert_eq!(answer[..9], [0, 1, 0, 0, 0, 5, 1, 4, 2]);
}
