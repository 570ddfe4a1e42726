//! RS-485 lines: what stations on them see.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Family, Format, Machine, Parity, RTU, Sent, Uart};

use crate::{on_each_board, set_up, started};

on_each_board!(
    a_request_on_one_line_reaches_the_device_on_another,
    corrupt_characters_are_counted_and_cost_one_frame,
    noise_through_which_every_bit_is_read_costs_nothing,
);

/// Unit 1 is asked for two registers, and responds.
pub(crate) const REQUEST: [u8; 8] = [1, 3, 0, 0, 0, 2, 0xc4, 0x0b];
pub(crate) const RESPONSE: [u8; 9] = [1, 3, 4, 0x12, 0x34, 0x56, 0x78, 0x81, 0x07];

pub(crate) fn bytes(sent: &[Sent]) -> Vec<u8> {
    sent.iter().map(|sent| sent.character.data).collect()
}

/// A frame without gaps of more than one and a half characters, and the driver on in each of its characters, but hardly before and behind it.
pub(crate) fn check_frame(machine: &Machine, line: Uart, sent: &[Sent]) {
    let driver = machine.driver(line);
    // The driver is on for two bits before and behind at most, and a little.
    let two_bits = Duration::from_secs(2) / sent[0].character.format.baud as u32 + Duration::from_micros(6);
    for character in sent {
        let &(on, _) =
            driver.iter().rfind(|(at, on)| *on && *at <= character.begin).expect("the driver is never on");
        let &(off, _) = driver.iter().find(|(at, is_on)| !*is_on && *at > on).expect("the driver stays on");
        assert!(off >= character.end, "the driver goes off within a character on {line:?}");
        assert!(on + two_bits > sent[0].begin, "the driver is on too early on {line:?}");
        assert!(off < sent[sent.len() - 1].end + two_bits, "the driver is off too late on {line:?}");
    }
    for pair in sent.windows(2) {
        let gap = pair[1].begin - pair[0].end;
        assert!(2 * gap < 3 * (pair[0].end - pair[0].begin), "a gap of {gap:?} within a frame on {line:?}");
    }
}

/// A board that passes requests of line 2 on to line 1 by `rule`.
fn routed(board: Board, rule: &str) -> Machine {
    let mut machine = started(board);
    let ports =
        ["port P1 serial uart1 rtu client 19200 8E1", "port P2 serial uart2 rtu server 19200 8E1", rule];
    set_up(&mut machine, &ports);
    // A client that has just opened its line waits for what may still be on its way from before.
    machine.run(Duration::from_secs(2)).unwrap();
    machine
}

fn a_request_on_one_line_reaches_the_device_on_another(board: Board) {
    let mut machine = routed(board, "route P2 1-64 * * P1");
    for _ in 0..3 {
        machine.send(Uart::Line2, &REQUEST, RTU);
        let request = machine.receive(Uart::Line1, REQUEST.len(), Duration::from_millis(50)).unwrap();
        assert_eq!(bytes(&request), REQUEST);
        assert!(request.iter().all(|sent| sent.character.format.parity == RTU.parity));
        machine.run(Duration::from_millis(3)).unwrap();
        check_frame(&machine, Uart::Line1, &request);
        machine.send(Uart::Line1, &RESPONSE, RTU);
        let response = machine.receive(Uart::Line2, RESPONSE.len(), Duration::from_millis(50)).unwrap();
        assert_eq!(bytes(&response), RESPONSE);
        machine.run(Duration::from_millis(3)).unwrap();
        check_frame(&machine, Uart::Line2, &response);
    }
}

/// What characters and frames may have.
const FLAWS: [&str; 4] = ["parity", "framing", "overruns", "corrupt"];

/// How often `event` has happened at a port, as `show stats` has it.
fn count(stats: &str, port: &str, event: &str) -> u32 {
    let row = stats.lines().find(|line| line.split_whitespace().take(2).eq([port, event]));
    row.and_then(|row| row.split_whitespace().nth(2)?.parse().ok()).unwrap_or(0)
}

fn corrupt_characters_are_counted_and_cost_one_frame(board: Board) {
    let mut machine = routed(board, "route P2 1-64 * * P1 cut off");
    // A bit of one character has fallen over, so that its parity is wrong.
    let odd = Format { parity: Parity::Odd, ..RTU };
    machine.send(Uart::Line2, &REQUEST[..3], RTU);
    machine.send(Uart::Line2, &[REQUEST[3] ^ 1], odd);
    machine.send(Uart::Line2, &REQUEST[4..], RTU);
    machine.run(Duration::from_millis(50)).unwrap();
    // A station at twice the speed.
    machine.send(Uart::Line2, &REQUEST, Format { baud: 38_400, ..RTU });
    machine.run(Duration::from_millis(50)).unwrap();
    let stats = machine.type_line("show stats").unwrap();
    assert!(count(&stats, "P2", "parity") > 0, "{stats}");
    assert!(count(&stats, "P2", "corrupt") > 0, "{stats}");
    machine.sent(Uart::Line1);
    // And a good one is routed.
    machine.send(Uart::Line2, &REQUEST, RTU);
    let request = machine.receive(Uart::Line1, REQUEST.len(), Duration::from_millis(50)).unwrap();
    assert_eq!(bytes(&request), REQUEST);
}

/// The receiver takes three samples of each bit, and notes where one of them differs from the other two. The frame's CRC tells whether
/// they were right, so the note is nothing that is counted, interrupts or delays.
fn noise_through_which_every_bit_is_read_costs_nothing(board: Board) {
    let mut machine = routed(board, "route P2 1-64 * * P1");
    let (before, mut instructions) = (machine.type_line("show stats").unwrap(), Vec::new());
    for is_noisy in [false, true, true] {
        let send = if is_noisy { Machine::send_noisy } else { Machine::send };
        let from = machine.instructions();
        send(&mut machine, Uart::Line2, &REQUEST, RTU);
        let request = machine.receive(Uart::Line1, REQUEST.len(), Duration::from_millis(50)).unwrap();
        assert_eq!(bytes(&request), REQUEST);
        send(&mut machine, Uart::Line1, &RESPONSE, RTU);
        let response = machine.receive(Uart::Line2, RESPONSE.len(), Duration::from_millis(50)).unwrap();
        assert_eq!(bytes(&response), RESPONSE);
        instructions.push(machine.instructions() - from);
        machine.run(Duration::from_millis(50)).unwrap();
    }
    // The F4's flag goes when the character is read.
    assert_eq!(machine.has_noise(Uart::Line2), board.family != Family::F4);
    assert!(instructions[1].abs_diff(instructions[0]) < instructions[0] / 10, "{instructions:?}");
    let stats = machine.type_line("show stats").unwrap();
    for (port, event) in ["P1", "P2"].into_iter().flat_map(|port| FLAWS.map(|event| (port, event))) {
        assert_eq!(count(&stats, port, event), count(&before, port, event), "{stats}");
    }
}
