//! pymodbus asks and pymodbus answers: the peers that know every public function code.

use std::thread;

use crate::lines::{Line, first_input, program};
use crate::outside::{Tool, script};

/// Lets pymodbus's client use and compare everything that it knows on `unit`, which its server knows as `target`.
fn compare_everything(port: u16, unit: u8, target: u8) {
    let script = script("client.py");
    let arguments = [port.to_string(), unit.to_string(), first_input(target).to_string()];
    let [port, unit, base] = &arguments;
    let (good, said) = Tool::python().run(&[script.to_str().unwrap(), port, unit, base]);
    assert!(good && said.contains("all compared"), "{said}");
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
