//! EtherCAT, with a LAN9252 at the board's SPI.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Controller, Machine};

use crate::clients::respond;
use crate::{on_each_board, set_up, wait_for_prompt};

on_each_board!(
    a_main_device_brings_the_board_to_op_and_sees_a_device,
    a_controller_that_was_reset_comes_to_op_again,
);

/// A board that has found the controller, with a device on its first line of which an input register is read.
fn with_controller(board: Board) -> (Machine, Controller) {
    let mut machine = Machine::new(board).unwrap();
    let mut controller = Controller::connect(&machine);
    controller.run(&mut machine, Duration::from_secs(5)).unwrap();
    wait_for_prompt(&mut machine);
    set_up(
        &mut machine,
        &[
            "port P1 serial uart1 rtu client 115200 8E1",
            "port ecat ethercat line P1",
            "route ecat 1-64 * * P1",
            "slave 0 unit 5 input 66 count 1 read 100ms",
        ],
    );
    (machine, controller)
}

fn shows_op(machine: &mut Machine) {
    let version = machine.type_line("show version").unwrap();
    assert!(version.contains("EtherCAT controller present, Op, RUN on, ERR off"), "{version}");
}

fn a_main_device_brings_the_board_to_op_and_sees_a_device(board: Board) {
    let (mut machine, mut controller) = with_controller(board);
    controller.bring_to_op(&mut machine).unwrap();
    shows_op(&mut machine);
    let mut asked = Vec::new();
    let end = machine.now() + Duration::from_secs(5);
    loop {
        let inputs = controller.exchange(&mut machine, vec![]).unwrap();
        // The register's value is its address, and the unit.
        if inputs[..2] == [66, 5] {
            break;
        }
        assert!(machine.now() < end, "{inputs:?}");
        for _ in 0..100 {
            controller.run(&mut machine, Duration::from_micros(200)).unwrap();
            respond(&mut machine, &mut asked);
        }
    }
    assert_eq!(controller.violations(), [""; 0]);
}

fn a_controller_that_was_reset_comes_to_op_again(board: Board) {
    let (mut machine, mut controller) = with_controller(board);
    controller.bring_to_op(&mut machine).unwrap();
    controller.reset();
    controller.run(&mut machine, Duration::from_secs(2)).unwrap();
    // The error that tells of the restart stands until the first try has acknowledged it.
    let _ = controller.bring_to_op(&mut machine);
    controller.bring_to_op(&mut machine).unwrap();
    shows_op(&mut machine);
}
