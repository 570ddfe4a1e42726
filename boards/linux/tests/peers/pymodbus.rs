//! pymodbus asks and pymodbus responds: the peers that know every public function code.

use std::thread;

use crate::common::{Program, free_port};
use crate::lines::{Line, first_input, program, pymodbus};
use crate::outside::{Tool, script};

/// Lets pymodbus's client use and compare everything that it knows on `unit`, which its server knows as `target`.
fn compare_everything(port: u16, unit: u8, target: u8) {
    compare_everything_by("tcp", port, unit, target);
}

/// The same by Modbus TCP (`tcp`), RTU over TCP (`rtu`) or Modbus UDP (`udp`).
fn compare_everything_by(framing: &str, port: u16, unit: u8, target: u8) {
    let script = script("client.py");
    let arguments = [format!("{framing}:{port}"), unit.to_string(), first_input(target).to_string()];
    let [at, unit, base] = &arguments;
    let (good, said) = Tool::python().run(&[script.to_str().unwrap(), at, unit, base]);
    assert!(good && said.contains("all compared"), "by {framing} from unit {unit}: {said}");
}

#[test]
fn every_function_of_pymodbus_passes_with_its_values_and_exceptions() {
    let lines = [Line::with_pymodbus(&[1])];
    let program = program(
        &lines,
        "route P502 1-247 * * P1
",
    );
    compare_everything(program.port, 1, 1);
}

#[test]
fn translated_units_on_two_lines_are_used_at_once_and_none_is_taken_for_another() {
    let lines = [Line::with_pymodbus(&[1, 32]), Line::with_pymodbus(&[1, 7])];
    let program = program(
        &lines,
        "route P502 101-132 * -100 P1
route P502 1-32 * * P2
route P502 255 * =7 P2
",
    );
    let port = program.port;
    let clients = [(101, 1), (132, 32), (1, 1), (255, 7)]
        .map(|(unit, target)| thread::spawn(move || compare_everything(port, unit, target)));
    clients.into_iter().for_each(|client| client.join().unwrap());
}

#[test]
fn pymodbus_in_every_framing_of_a_network_asks_pymodbus_behind_tcp() {
    let [tcp, rtu, rtu_server, udp_server] = [(); 4].map(|()| free_port());
    let _servers = [pymodbus(format!("tcp:{tcp}").into(), &[1]), pymodbus(format!("rtu:{rtu}").into(), &[2])];
    let program = Program::configured(&format!(
        "port T tcp client 127.0.0.1:{tcp} in-flight 4 timeout 5s
         port R tcp client 127.0.0.1:{rtu} rtu timeout 5s late-window 200ms
         port P502 tcp server {{port}}
         port RS tcp server {rtu_server} rtu
         port US udp server {udp_server}
         route P502 1 * * T
         route P502 2 * * R
         route RS 1 * * T
         route RS 2 * * R
         route US 1 * * T
         route US 2 * * R
"
    ));
    program.logs("listening on UDP port");
    for (framing, port) in [("tcp", program.port), ("rtu", rtu_server), ("udp", udp_server)] {
        for unit in [1, 2] {
            compare_everything_by(framing, port, unit, unit);
        }
    }
}
