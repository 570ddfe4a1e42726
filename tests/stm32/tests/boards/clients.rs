//! Many TCP clients at a time, at a line of 115200 baud.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Character, Client, Family, Format, Machine, Network, Parity, Uart};

use crate::figure::{Target, figure};
use crate::lines::bytes;
use crate::network::{BOARD, STATION};
use crate::{on_each_board, set_up, started};

on_each_board!(as_many_clients_as_the_board_has_are_served_at_a_time, instructions_of_a_transaction);

pub(crate) const FAST: Format = Format { baud: 115_200, data_bits: 8, parity: Parity::Even, stop_bits: 1 };
const ROUNDS: u16 = 5;
/// What a transaction from TCP to RTU is to take.
const INSTRUCTIONS_MAX: f64 = 30_000.0;
/// What each further character of a response is to take: its interrupt and its copies. A wake-up of the port takes 2 000.
const CHARACTER_INSTRUCTIONS_MAX: u64 = 300;
/// Registers of the longest response.
const REGISTERS_MAX: u8 = 125;

/// The CRC of RTU.
pub(crate) fn crc(bytes: &[u8]) -> [u8; 2] {
    let crc = bytes.iter().fold(0xffff_u16, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte), |crc, _| crc >> 1 ^ if crc & 1 != 0 { 0xa001 } else { 0 })
    });
    crc.to_le_bytes()
}

/// Lets a device respond to what the board has sent: each register is the address of the first, and the unit.
pub(crate) fn respond(machine: &mut Machine, asked: &mut Vec<u8>) {
    let sent = machine.sent(Uart::Line1);
    if let (Some(first), Some(last)) = (sent.first(), sent.last()) {
        let Character { format, .. } = first.character;
        assert_eq!(format.parity, FAST.parity);
        assert!(last.end > first.begin);
    }
    asked.extend(bytes(&sent));
    if asked.len() == 8 {
        assert_eq!(asked[6..], crc(&asked[..6]));
        let mut response = vec![asked[0], asked[1], 2 * asked[5]];
        response.extend([asked[3], asked[0]].repeat(asked[5].into()));
        response.extend(crc(&response));
        machine.send(Uart::Line1, &response, FAST);
        asked.clear();
    }
}

/// A board with a client of its own at 192.168.7.1, for a line of 115200 baud.
fn routing(board: Board) -> Machine {
    let mut machine = started(board);
    set_up(
        &mut machine,
        &[
            "network address 192.168.7.2/24",
            "port P1 serial uart1 rtu client 115200 8E1",
            "port P502 tcp server 502",
            "route P502 1-64 * * P1",
        ],
    );
    // A client that has just opened its line waits for what may still be on its way from before.
    machine.run(Duration::from_secs(2)).unwrap();
    machine
}

fn instructions_of_a_transaction(board: Board) {
    let mut machine = routing(board);
    let mut network = Network::new(STATION);
    let client = network.connect(&mut machine, BOARD, 502).unwrap();
    let mut measure = |registers| {
        let rounds = 0..ROUNDS;
        let least =
            rounds.map(|round| transaction(&mut machine, &mut network, client, round, registers)).min();
        println!("the most of the last one: {:#?}", &machine.busiest()[..20]);
        least.unwrap()
    };
    let (short, long) = (measure(1), measure(REGISTERS_MAX));
    let name = board.name.trim_start_matches("nucleo_");
    // The F429 is not promised for it.
    let target = if board.family == Family::F4 { Target::None } else { Target::AtMost(INSTRUCTIONS_MAX) };
    figure(&format!("{name}_transaction_instructions"), short as f64, "instructions", target);
    figure(&format!("{name}_long_transaction_instructions"), long as f64, "instructions", Target::None);
    let more = 2 * (u64::from(REGISTERS_MAX) - 1);
    assert!(long - short < more * CHARACTER_INSTRUCTIONS_MAX, "each character wakes the port");
}

/// Instructions from a request for so many registers to its response.
fn transaction(
    machine: &mut Machine,
    network: &mut Network,
    client: Client,
    round: u16,
    registers: u8,
) -> u64 {
    let mut asked = Vec::new();
    // The acknowledgement of the last response is not this one's.
    network.run(machine, Duration::from_millis(20), |_| false).unwrap();
    let before = machine.instructions();
    machine.busiest();
    network.send(client, round, 1, &[3, 0, 7, 0, registers]);
    while network.receive(client).is_none() {
        network.run(machine, Duration::from_micros(200), |_| false).unwrap();
        respond(machine, &mut asked);
    }
    machine.instructions() - before
}

pub(crate) fn as_many_clients_as_the_board_has_are_served_at_a_time(board: Board) {
    let clients = if board.family == Family::F4 { 8 } else { 16 };
    let mut machine = routing(board);
    let mut network = Network::new(STATION);
    let clients: Vec<Client> =
        (0..clients).map(|_| network.connect(&mut machine, BOARD, 502).unwrap()).collect();
    // In one instant: one frame behind the other on the cable. The H743 has memory for four that are not looked at yet.
    let apart = Duration::from_micros(if board.family == Family::H7 { 50 } else { 0 });
    let mut asked = Vec::new();
    for round in 0..ROUNDS {
        for (unit, &client) in (1..).zip(&clients) {
            network.send(client, round, unit, &[3, 0, round as u8 + unit, 0, 1]);
            network.run(&mut machine, apart, |_| false).unwrap();
        }
        let mut waiting: Vec<_> = (1..).zip(clients.iter().copied()).collect();
        let end = machine.now() + Duration::from_secs(1);
        while !waiting.is_empty() {
            let dropped = machine.frames_dropped();
            assert!(machine.now() < end, "{waiting:?} have no response; {dropped} frames were dropped");
            network.run(&mut machine, Duration::from_micros(200), |_| false).unwrap();
            respond(&mut machine, &mut asked);
            waiting.retain(|&(unit, client)| {
                let Some(response) = network.receive(client) else { return true };
                assert_eq!(response, (round, unit, vec![3, 2, round as u8 + unit, unit]));
                false
            });
        }
    }
    assert_eq!(machine.frames_dropped(), 0, "the Ethernet had no room for them");
    let stats = machine.type_line("show stats").unwrap();
    let expected = clients.len() * usize::from(ROUNDS);
    let row = stats.lines().find(|line| line.split_whitespace().take(2).eq(["P1", "responses"]));
    assert_eq!(row.and_then(|row| row.split_whitespace().nth(2)?.parse().ok()), Some(expected), "{stats}");
}
