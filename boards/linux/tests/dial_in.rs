//! The program with devices that connect to it.

use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::thread;

use common::{PATIENCE, Program, ask, converse, free_port, wait_for, with_console};
use mobgate_simulator::device::rtu;

mod common;

const READ: [u8; 5] = [3, 0, 7, 0, 1];

/// Two devices that are told apart by their first bytes, one by Modbus TCP, the other by RTU over TCP.
fn settings(devices: u16) -> String {
    format!(
        "port P502 tcp server {{port}}
port east tcp client listen 127.0.0.1:{devices} first \"EAST\"
port west tcp client listen 127.0.0.1:{devices} rtu first 0x7E01 late-window 0
route P502 1 * * east
route P502 2 * * west
"
    )
}

/// Connects as a device does, and says these bytes.
fn dial(devices: u16, first: &[u8]) -> TcpStream {
    let mut stream = TcpStream::connect((Ipv4Addr::LOCALHOST, devices)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(first).unwrap();
    stream
}

/// Serves reads of one register on a connection, with a heartbeat before each response.
fn serve(mut stream: TcpStream, unit: u8, is_rtu: bool) {
    thread::spawn(move || {
        let mut request = [0; 260];
        loop {
            match stream.read(&mut request) {
                Ok(0) => return,
                Err(error) if error.kind() != ErrorKind::WouldBlock => return,
                _ => {}
            }
            let pdu = [3, 2, unit, 7];
            let response = match is_rtu {
                true => rtu::frame(unit, &pdu),
                false => [&request[..4], &[0, 5, unit], &pdu].concat(),
            };
            stream.write_all(b"alive").unwrap();
            stream.write_all(&response).unwrap();
        }
    });
}

/// What unit `unit` responds to a read, once it does.
fn asked(program: &Program, unit: u8) {
    let mut client = program.connect();
    wait_for("the device's response", || (ask(&mut client, unit, &READ) == [3, 2, unit, 7]).then_some(()));
}

#[test]
fn devices_connect_are_told_apart_and_answer_requests() {
    let devices = free_port();
    let program = with_console(&settings(devices));
    assert_eq!(ask(&mut program.connect(), 1, &READ), [0x83, 0x0a], "nothing has connected");
    let mut console = program.session();
    let waiting = converse(&mut console, "show ports\n", "west");
    assert!(waiting.contains("waits for its device"), "{waiting}");
    let (east, west) = (dial(devices, b"EAST"), dial(devices, &[0x7e, 0x01]));
    let (of_east, of_west) = (east.local_addr().unwrap(), west.local_addr().unwrap());
    serve(east, 1, false);
    serve(west, 2, true);
    asked(&program, 1);
    asked(&program, 2);
    let shown = converse(&mut console, "show ports\n", &format!("open, device {of_west}"));
    assert!(shown.contains(&format!("open, device {of_east}")), "{shown}");
}

#[test]
fn a_further_connection_replaces_the_one_before_and_others_are_refused() {
    let devices = free_port();
    let program = with_console(&settings(devices));
    let mut console = program.session();
    let mut before = dial(devices, b"EAST");
    let mut shown = || converse(&mut console, "show ports\n", "west");
    wait_for("the device in show ports", || shown().contains("open, device").then_some(()));
    serve(dial(devices, b"EAST"), 1, false);
    asked(&program, 1);
    assert_eq!(before.read(&mut [0; 16]).unwrap_or(0), 0, "the connection before is over");
    let mut wrong = dial(devices, b"NORTH");
    assert_eq!(wrong.read(&mut [0; 16]).unwrap_or(0), 0);
    program.logs("a device is refused, it is that of no port, at port east");
    asked(&program, 1);
}

#[test]
fn a_taken_port_is_told_at_the_start() {
    let (_taken, port) = common::listening();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mobgate.conf");
    std::fs::write(&file, format!("port east tcp client listen 127.0.0.1:{port}\n")).unwrap();
    let said = common::refusal(&["--config", file.to_str().unwrap(), "--socket", "off"]);
    assert!(said.contains(&format!("port east: TCP port 127.0.0.1:{port}: in use")), "{said}");
}
