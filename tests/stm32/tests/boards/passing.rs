//! Frames that are passed on from line to line while they arrive.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Family, Format, Machine, Uart};

use crate::clients::{FAST, crc};
use crate::figure::{Target, figure};
use crate::lines::{bytes, check_frame};
use crate::{on_each_board, set_up, started};

on_each_board!(a_long_frame_is_passed_on_while_it_arrives);

/// What a byte that is passed on is to take, besides what the UARTs' own drivers take; all is measured.
const INSTRUCTIONS_MAX: f64 = 60.0;

/// A write of so many registers to unit 1.
fn write(registers: u8) -> Vec<u8> {
    let mut frame = vec![1, 16, 0, 0, 0, registers, 2 * registers];
    frame.extend((0..2 * registers).map(|byte| byte.wrapping_mul(37)));
    frame.extend(crc(&frame));
    frame
}

/// Sends a frame from line 2 to line 1; the time from its begin there to its end here, and the instructions.
fn pass(machine: &mut Machine, family: Family, frame: &[u8], format: Format) -> (Duration, u64) {
    machine.sent(Uart::Line1);
    let (begin, before) = (machine.now(), machine.instructions());
    machine.send(Uart::Line2, frame, format);
    let sent = machine.receive(Uart::Line1, frame.len(), Duration::from_millis(100)).unwrap();
    let instructions = machine.instructions() - before;
    assert_eq!(bytes(&sent), frame);
    machine.run(Duration::from_millis(1)).unwrap();
    check_frame(machine, Uart::Line1, &sent);
    // The F4's driver is a pin, which an interrupt switches at each pause.
    if family != Family::F4 {
        let begin = sent[0].begin.saturating_sub(Duration::from_micros(100));
        let switched = machine.driver(Uart::Line1).iter().filter(|(at, _)| *at > begin).count();
        assert_eq!(switched, 2, "the driver goes off within a frame");
    }
    // The device confirms it, and all becomes quiet.
    let mut response = frame[..6].to_vec();
    response.extend(crc(&response));
    machine.send(Uart::Line1, &response, format);
    machine.run(Duration::from_millis(20)).unwrap();
    assert_eq!(bytes(&machine.sent(Uart::Line2)), response);
    (sent[sent.len() - 1].end - begin, instructions)
}

fn a_long_frame_is_passed_on_while_it_arrives(board: Board) {
    let mut machine = started(board);
    set_up(
        &mut machine,
        &[
            "port P1 serial uart1 rtu client 115200 8E1",
            "port P2 serial uart2 rtu server 115200 8E1",
            "route P2 1-64 * * P1",
        ],
    );
    machine.run(Duration::from_secs(2)).unwrap();
    let (_, short) = pass(&mut machine, board.family, &write(20), FAST);
    let frame = write(100);
    let (took, long) = pass(&mut machine, board.family, &frame, FAST);
    let arrives = Duration::from_secs(1) * frame.len() as u32 * FAST.bits() / FAST.baud as u32;
    let ratio = took.as_secs_f64() / arrives.as_secs_f64();
    // A sender that is slower by its crystal is waited for. The device's response is as slow.
    for slower in [1000, 200, 50] {
        pass(&mut machine, board.family, &frame, Format { baud: FAST.baud - FAST.baud / slower, ..FAST });
    }
    // An F7 stands still while its flash is erased, and would tear a frame: it stores them first.
    let most = if board.family == Family::F7 { 2.1 } else { 1.02 };
    assert!(ratio < most, "{ratio}");
    if board.family != Family::F7 {
        let name = format!("{}_passed_byte_instructions", board.name.trim_start_matches("nucleo_"));
        figure(&name, (long - short) as f64 / 160.0, "instructions", Target::AtMost(INSTRUCTIONS_MAX));
    }
}
