//! Requests that a client sends without waiting, and units that do not respond, with servers by others on the lines.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::thread;
use std::time::{Duration, Instant};

use crate::common::ask;
use crate::lines::{Line, first_input, program};

const NO_RESPONSE: [u8; 2] = [0x84, 0x0b];
/// Input register 5, alone.
const READ: [u8; 5] = [4, 0, 5, 0, 1];

fn response(unit: u8) -> [u8; 4] {
    let [high, low] = (first_input(unit) + 5).to_be_bytes();
    [4, 2, high, low]
}

/// One response from the stream: transaction, unit, PDU.
fn receive(stream: &mut TcpStream) -> (u16, u8, Vec<u8>) {
    let mut head = [0; 7];
    stream.read_exact(&mut head).unwrap();
    let mut pdu = vec![0; usize::from(u16::from_be_bytes([head[4], head[5]])) - 1];
    stream.read_exact(&mut pdu).unwrap();
    (u16::from_be_bytes([head[0], head[1]]), head[6], pdu)
}

#[test]
fn sixteen_requests_in_one_segment_to_two_lines_all_get_their_own_responses() {
    let lines = [Line::with_pymodbus(&[1, 2, 3]), Line::with_rmodbus(9)];
    let program = program(
        &lines,
        "route P502 9 * * P2
route P502 1-3 * * P1
",
    );
    let mut stream = program.connect();
    for round in 0..10 {
        let sent: Vec<(u16, u8)> =
            (0..16).map(|index| (1000 * round + index, [1, 9, 2, 3][usize::from(index) % 4])).collect();
        let request = |&(transaction, unit): &(u16, u8)| {
            [&transaction.to_be_bytes()[..], &[0, 0, 0, 6, unit], &READ].concat()
        };
        stream.write_all(&sent.iter().flat_map(request).collect::<Vec<_>>()).unwrap();
        let mut received: Vec<_> = sent.iter().map(|_| receive(&mut stream)).collect();
        received.sort();
        let expected: Vec<_> =
            sent.iter().map(|&(transaction, unit)| (transaction, unit, response(unit).to_vec())).collect();
        assert_eq!(received, expected);
    }
}

#[test]
fn a_living_unit_answers_beside_a_dead_one_that_another_client_keeps_asking() {
    let lines = [Line::with_rmodbus(9)];
    let program = program(&lines, "route P502 * * * P1\n");
    let mut impatient = program.connect();
    let dead = thread::spawn(move || {
        // Three time-outs in a row, and the unit is down: from then on it is refused at once.
        for _ in 0..3 {
            assert_eq!(ask(&mut impatient, 77, &READ), NO_RESPONSE);
        }
        // The shortest: between them the unit is probed, and the machine may be busy.
        let refused = (0..5).map(|_| {
            let asked = Instant::now();
            assert_eq!(ask(&mut impatient, 77, &READ), NO_RESPONSE);
            asked.elapsed()
        });
        refused.min().unwrap()
    });
    let mut client = program.connect();
    let mut responses = 0;
    while !dead.is_finished() {
        assert_eq!(ask(&mut client, 9, &READ), response(9));
        responses += 1;
    }
    let took = dead.join().unwrap();
    assert!(took < Duration::from_millis(250), "a unit that is down was refused after {took:?}");
    // One behind each time-out. While the dead unit is refused at once, their number is up to the machine.
    assert!(responses >= 3, "{responses} responses of the living unit");
}
