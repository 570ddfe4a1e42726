//! Frames that are passed on from line to line while they arrive.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Family, Format, Machine, Parity, RTU, Sent, Uart};

use crate::clients::{FAST, crc};
use crate::figure::{Target, figure};
use crate::lines::{bytes, check_frame};
use crate::{on_each_board, set_up, started};

on_each_board!(
    a_long_frame_is_passed_on_while_it_arrives,
    lines_may_differ_in_speed_and_format,
    a_pause_is_passed_on_and_a_longer_one_breaks_the_frame_off,
    what_is_corrupt_stays_corrupt,
    two_pairs_of_lines_pass_frames_on_at_a_time,
);

/// What a byte that is passed on is to take, besides what the UARTs' own drivers take.
const INSTRUCTIONS_MAX: f64 = 60.0;
const PATIENCE: Duration = Duration::from_millis(500);

/// A frame with its CRC.
fn framed(mut frame: Vec<u8>) -> Vec<u8> {
    frame.extend(crc(&frame));
    frame
}

/// A write of so many registers to unit 1.
fn write(registers: u8) -> Vec<u8> {
    let mut frame = vec![1, 16, 0, 0, 0, registers, 2 * registers];
    frame.extend((0..2 * registers).map(|byte| byte.wrapping_mul(37)));
    framed(frame)
}

/// How long a frame takes.
fn duration(frame: &[u8], format: Format) -> Duration {
    Duration::from_secs(1) * frame.len() as u32 * format.bits() / format.baud as u32
}

/// Lines with these formats, from the second one to the first one.
fn passing(board: Board, upper: &str, lower: &str) -> Machine {
    let mut machine = started(board);
    set_up(
        &mut machine,
        &[
            &format!("port P1 serial uart1 rtu client {lower}"),
            &format!("port P2 serial uart2 rtu server {upper}"),
            "route P2 1-9 * * P1",
            "route P2 101-109 * -100 P1",
        ],
    );
    machine.run(Duration::from_secs(2)).unwrap();
    machine
}

/// Waits for a frame and checks gaps and driver.
fn receive(machine: &mut Machine, uart: Uart, frame: &[u8]) -> Vec<Sent> {
    let sent = machine.receive(uart, frame.len(), PATIENCE).unwrap();
    assert_eq!(bytes(&sent), frame);
    machine.run(Duration::from_millis(1)).unwrap();
    check_frame(machine, uart, &sent);
    let begin = sent[0].begin.saturating_sub(Duration::from_micros(100));
    // An F7's tasks give the last character within 25 us, and its UART holds the driver for 31/16 bits.
    let end = sent[sent.len() - if machine.family() == Family::F7 { 2 } else { 1 }].end;
    let driver = machine.driver(uart);
    let within = driver.iter().filter(|(at, _)| *at > begin && *at < end).collect::<Vec<_>>();
    assert_eq!(within.len(), 1, "the driver goes off within a frame: {within:?}");
    sent
}

/// Passes a write from line 2 to line 1, and its response back. Returns the time from the begin there to the end here.
fn pass(machine: &mut Machine, frame: &[u8], format: Format, below: Format) -> Duration {
    let begin = machine.now();
    machine.send(Uart::Line2, frame, format);
    let sent = receive(machine, Uart::Line1, frame);
    let response = framed(frame[..6].to_vec());
    machine.send(Uart::Line1, &response, below);
    receive(machine, Uart::Line2, &response);
    machine.run(Duration::from_millis(20)).unwrap();
    sent[sent.len() - 1].end - begin
}

/// Instructions for a write: of the UARTs' driver, which takes a character or gives one to the transmitter, and all others.
fn work(machine: &mut Machine, frame: &[u8]) -> [f64; 2] {
    machine.busiest();
    machine.send(Uart::Line2, frame, FAST);
    // Without what the frame's end takes, which is the same for each length.
    machine.run(duration(frame, FAST)).unwrap();
    let busiest = machine.busiest();
    let response = framed(frame[..6].to_vec());
    machine.run(Duration::from_millis(2)).unwrap();
    machine.sent(Uart::Line1);
    machine.send(Uart::Line1, &response, FAST);
    machine.run(Duration::from_millis(20)).unwrap();
    machine.sent(Uart::Line2);
    let is_relay = |name: &str| name.ends_with("::step");
    assert!(busiest.iter().any(|(_, name)| is_relay(name)), "nothing was passed on by an interrupt");
    let parts = ["<mobgate_stm32::shift::Shift>", "<mobgate_stm32::line::UartLine as", "USART", "UART"];
    let is_driver = |name: &str| {
        // Its future for reading is a closure that is polled.
        let of = name.trim_start_matches("<core::future::poll_fn::PollFn<");
        parts.iter().any(|part| of.starts_with(part)) && !is_relay(name)
    };
    let sum = |driver| {
        busiest.iter().filter(|(_, name)| is_driver(name) == driver).map(|(count, _)| *count as f64).sum()
    };
    [sum(true), sum(false)]
}

fn a_long_frame_is_passed_on_while_it_arrives(board: Board) {
    let mut machine = passing(board, "115200 8E1", "115200 8E1");
    let (short, long) = (write(20), write(100));
    pass(&mut machine, &short, FAST, FAST);
    let took = pass(&mut machine, &long, FAST, FAST);
    let ratio = took.as_secs_f64() / duration(&long, FAST).as_secs_f64();
    assert!(ratio < 1.02, "{ratio}");
    // A sender's crystal may be slower or faster.
    for apart in [1000, 200, 50] {
        for baud in [FAST.baud - FAST.baud / apart, FAST.baud + FAST.baud / apart] {
            pass(&mut machine, &long, Format { baud, ..FAST }, FAST);
        }
    }
    // Another unit's id, which changes the CRC.
    let to = |unit: u8| framed([&[unit], &long[1..long.len() - 2]].concat());
    machine.send(Uart::Line2, &to(107), FAST);
    receive(&mut machine, Uart::Line1, &to(7));
    machine.run(Duration::from_secs(2)).unwrap();

    let [few, many] = [short, long].map(|frame| work(&mut machine, &frame));
    let name = board.name.trim_start_matches("nucleo_");
    let each = |which: usize| (many[which] - few[which]) / 160.0;
    figure(&format!("{name}_passed_byte_driver_instructions"), each(0), "instructions", Target::None);
    let target = Target::AtMost(INSTRUCTIONS_MAX);
    figure(&format!("{name}_passed_byte_instructions"), each(1), "instructions", target);
}

fn lines_may_differ_in_speed_and_format(board: Board) {
    let slow = Format { baud: 9_600, ..FAST };
    let bare = Format { parity: Parity::None, ..FAST };
    for (upper, lower, formats) in [
        ("115200 8E1", "9600 8E1", (FAST, slow)),
        ("9600 8E1", "115200 8E1", (slow, FAST)),
        ("115200 8N1", "115200 8E1", (bare, FAST)),
        ("115200 8E1", "115200 8N1", (FAST, bare)),
    ] {
        let mut machine = passing(board, upper, lower);
        for registers in [2, 120] {
            pass(&mut machine, &write(registers), formats.0, formats.1);
        }
    }
}

fn a_pause_is_passed_on_and_a_longer_one_breaks_the_frame_off(board: Board) {
    let mut machine = passing(board, "19200 8E1", "19200 8E1");
    let frame = write(60);
    let (first, rest) = frame.split_at(50);
    let character = duration(&[0], RTU);
    // Within t1.5.
    machine.send(Uart::Line2, first, RTU);
    machine.run(duration(first, RTU) + character * 5 / 4).unwrap();
    machine.send(Uart::Line2, rest, RTU);
    machine.run(duration(rest, RTU) + Duration::from_millis(5)).unwrap();
    let sent = machine.sent(Uart::Line1);
    assert_eq!(bytes(&sent), frame);
    check_frame(&machine, Uart::Line1, &sent);
    machine.send(Uart::Line1, &framed(frame[..6].to_vec()), RTU);
    machine.run(Duration::from_millis(50)).unwrap();
    machine.sent(Uart::Line2);
    // More than t3.5, and the master goes away.
    for rest in [rest, &[]] {
        pass(&mut machine, &frame, RTU, RTU);
        machine.send(Uart::Line2, first, RTU);
        machine.run(duration(first, RTU) + character * 4).unwrap();
        machine.send(Uart::Line2, rest, RTU);
        machine.run(Duration::from_secs(1)).unwrap();
        let sent = machine.sent(Uart::Line1);
        assert_eq!(bytes(&sent), first);
        assert_eq!(bytes(&machine.sent(Uart::Line2)), []);
        // A pin holds the driver until the frame is known to have broken off.
        let (driver, end) = (machine.driver(Uart::Line1), sent[49].end);
        let off = driver.iter().find(|(at, on)| !*on && *at >= end).expect("the driver stays on").0;
        assert!(off < end + character * 4, "{:?}", off - end);
    }
    pass(&mut machine, &frame, RTU, RTU);
}

fn what_is_corrupt_stays_corrupt(board: Board) {
    let mut machine = passing(board, "115200 8E1", "115200 8E1");
    let frame = write(50);
    for place in [40, 99, frame.len() - 2, frame.len() - 1] {
        let mut corrupt = frame.clone();
        corrupt[place] ^= 0x10;
        machine.send(Uart::Line2, &corrupt, FAST);
        receive(&mut machine, Uart::Line1, &corrupt);
        machine.run(Duration::from_millis(50)).unwrap();
        assert_eq!(bytes(&machine.sent(Uart::Line2)), [], "nothing responds to it");
        pass(&mut machine, &frame, FAST, FAST);
    }
}

fn two_pairs_of_lines_pass_frames_on_at_a_time(board: Board) {
    let mut machine = started(board);
    let mut lines = Vec::new();
    for (lower, upper) in [(1, 2), (3, 4)] {
        lines.push(format!("port P{lower} serial uart{lower} rtu client 115200 8E1"));
        lines.push(format!("port P{upper} serial uart{upper} rtu server 115200 8E1"));
        lines.push(format!("route P{upper} 1-64 * * P{lower}"));
    }
    set_up(&mut machine, &lines.iter().map(String::as_str).collect::<Vec<_>>());
    machine.run(Duration::from_secs(2)).unwrap();
    let (frame, other) = (write(100), write(90));
    machine.send(Uart::Line2, &frame, FAST);
    machine.run(Duration::from_micros(317)).unwrap();
    machine.send(Uart::Line4, &other, FAST);
    let (begin, first) = (machine.now(), receive(&mut machine, Uart::Line1, &frame));
    let second = receive(&mut machine, Uart::Line3, &other);
    let end = begin + duration(&frame, FAST) * 51 / 50;
    assert!(first[first.len() - 1].end < end && second[second.len() - 1].end < end);
}
