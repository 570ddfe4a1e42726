//! The Ethernet: Modbus TCP clients, and a PHY that is not there.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Machine, Network, RTU, Uart};

use crate::lines::{REQUEST, RESPONSE, bytes, check_frame};
use crate::{on_each_board, set_up, started, wait_for_prompt};

on_each_board!(
    a_cable_that_was_pulled_out_works_again,
    a_tcp_client_reaches_a_device_on_a_line,
    without_a_phy_the_console_and_the_lines_are_there
);

pub(crate) const STATION: [u8; 4] = [192, 168, 7, 1];
pub(crate) const BOARD: [u8; 4] = [192, 168, 7, 2];
/// What a serial line and a server on TCP need.
pub(crate) const SETTINGS: &[&str] = &[
    "network address 192.168.7.2/24",
    "port P1 serial uart1 rtu client 19200 8E1",
    "port P502 tcp server 502",
    "route P502 1-64 * * P1",
];

fn a_tcp_client_reaches_a_device_on_a_line(board: Board) {
    let mut machine = started(board);
    set_up(&mut machine, SETTINGS);
    machine.run(Duration::from_secs(2)).unwrap();
    let mut network = Network::new(STATION);
    let client = network.connect(&mut machine, BOARD, 502).unwrap();
    for transaction in 0..3 {
        network.send(client, transaction, REQUEST[0], &REQUEST[1..6]);
        let asked = |network: &mut Network, machine: &mut Machine| {
            network.run(machine, Duration::from_millis(7), |_| false).unwrap();
        };
        asked(&mut network, &mut machine);
        let request = machine.sent(Uart::Line1);
        assert_eq!(bytes(&request), REQUEST);
        check_frame(&machine, Uart::Line1, &request);
        machine.send(Uart::Line1, &RESPONSE, RTU);
        let mut response = None;
        let arrives = network.run(&mut machine, Duration::from_millis(20), |network| {
            response = network.receive(client);
            response.is_some()
        });
        assert!(arrives.unwrap(), "no response");
        assert_eq!(response, Some((transaction, RESPONSE[0], RESPONSE[1..7].to_vec())));
    }
}

fn without_a_phy_the_console_and_the_lines_are_there(board: Board) {
    let mut machine = Machine::without_phy(board).unwrap();
    wait_for_prompt(&mut machine);
    set_up(&mut machine, SETTINGS);
    set_up(&mut machine, &["port P2 serial uart2 rtu server 19200 8E1", "route P2 1-64 * * P1"]);
    // Longer than the watchdog waits.
    machine.run(Duration::from_secs(12)).unwrap();
    assert_eq!(machine.resets, []);
    machine.send(Uart::Line2, &REQUEST, RTU);
    let request = machine.receive(Uart::Line1, REQUEST.len(), Duration::from_millis(50)).unwrap();
    assert_eq!(bytes(&request), REQUEST);
}

fn a_cable_that_was_pulled_out_works_again(board: Board) {
    let mut machine = started(board);
    set_up(&mut machine, SETTINGS);
    let mut network = Network::new(STATION);
    network.connect(&mut machine, BOARD, 502).unwrap();
    machine.plug_cable(false);
    machine.run(Duration::from_secs(1)).unwrap();
    let shown = machine.type_line("show network").unwrap();
    assert!(shown.contains("down"), "{shown}");
    assert!(network.connect(&mut machine, BOARD, 502).is_err());
    machine.plug_cable(true);
    machine.run(Duration::from_secs(1)).unwrap();
    network.connect(&mut machine, BOARD, 502).unwrap();
}
