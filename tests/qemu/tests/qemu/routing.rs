//! Requests find their devices, and what becomes of those that do not respond.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::thread;
use std::time::{Duration, Instant};

use mobgate_simulator::device::rtu;

use crate::{Bench, registers};

#[test]
fn requests_reach_the_units_of_three_lines_by_rule_and_by_tag() {
    let bench = Bench::new();
    let mut client = bench.machine.client();
    for unit in [1, 65, 131] {
        assert_eq!(client.read(unit, 7, 3), registers(unit, 7, 3));
    }
    assert_eq!(client.read(65, 0, 125), registers(65, 0, 125), "the longest response");
    let mut console = bench.machine.console();
    assert_eq!(console.run("insert route 1 P502 201-203 * -200 P1 readonly"), "");
    assert_eq!(client.read(202, 7, 3), registers(2, 7, 3));
    assert_eq!(client.ask(202, &[6, 0, 1, 0, 9]), [0x86, 1], "only reads pass there");
    assert_eq!(client.ask(2, &[6, 0, 1, 0, 9]), [6, 0, 1, 0, 9]);
    assert_eq!(bench.buses[0].holding(2, 1), 9);
    assert_eq!(client.read(250, 0, 1), [0x83, 0x0a], "no rule");
}

#[test]
fn a_silent_unit_times_out_goes_down_and_slows_no_other() {
    let bench = Bench::new();
    bench.buses[0].set_silent(1, true);
    let mut client = bench.machine.client();
    for _ in 0..3 {
        let start = Instant::now();
        assert_eq!(client.read(1, 0, 1), [0x83, 0x0b]);
        assert!(start.elapsed() > Duration::from_millis(290), "{:?}", start.elapsed());
    }
    let start = Instant::now();
    for _ in 0..10 {
        assert_eq!(client.read(1, 0, 1), [0x83, 0x0b]);
        assert_eq!(client.read(2, 0, 1), registers(2, 0, 1));
    }
    assert!(start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
    let units = bench.machine.console().run("show units");
    assert!(units.lines().any(|line| line.split_whitespace().take(3).eq(["P1", "1", "down"])), "{units}");

    bench.buses[0].set_silent(1, false);
    mobgate_qemu::wait_for("the unit to be up again", || {
        (client.read(1, 0, 1) == registers(1, 0, 1)).then_some(())
    });
}

#[test]
fn a_master_on_a_serial_line_reaches_another_line() {
    let bench = Bench::unwired();
    bench.machine.wire(3, &bench.buses[2]);
    let mut console = bench.machine.console();
    for line in
        ["delete routes", "port P2 serial uart2 rtu server 115200 8N1", "route P2 129-131 * * P3 cut on"]
    {
        assert_eq!(console.run(line), "");
    }
    let mut master = bench.machine.uart(2);
    // What comes before the first silence on a line may be the end of something.
    thread::sleep(Duration::from_millis(200));
    for unit in [129, 131] {
        master.write_all(&rtu::frame(unit, &[3, 0, 5, 0, 2])).unwrap();
        let mut response = [0; 9];
        master.read_exact(&mut response).unwrap();
        assert_eq!(response[..], rtu::frame(unit, &registers(unit, 5, 2)));
    }
}

#[test]
fn a_server_in_the_boards_network_is_asked_by_tcp() {
    // 10.0.2.2 is the host as the board sees it.
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = server.local_addr().unwrap().port();
    thread::spawn(move || {
        let (mut stream, _) = server.accept().unwrap();
        let mut request = [0; 12];
        while stream.read_exact(&mut request).is_ok() {
            let [a, b, .., unit, function, _, _, _, _] = request;
            stream.write_all(&[a, b, 0, 0, 0, 5, unit, function, 2, 0xbe, 0xef]).unwrap();
        }
    });
    let bench = Bench::new();
    let mut console = bench.machine.console();
    assert_eq!(console.run(&format!("port plc tcp client 10.0.2.2:{port}")), "");
    assert_eq!(console.run("insert route 1 P502 200 * * plc"), "");
    let mut client = bench.machine.client();
    for _ in 0..3 {
        assert_eq!(client.read(200, 0, 1), [3, 2, 0xbe, 0xef]);
    }
}
