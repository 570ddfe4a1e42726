//! EtherCAT, with a LAN9252 at the board's SPI.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Controller, Machine};

use crate::{on_each_board, set_up, wait_for_prompt};

on_each_board!(a_main_device_brings_the_board_to_op);

fn a_main_device_brings_the_board_to_op(board: Board) {
    let mut machine = Machine::new(board).unwrap();
    let mut controller = Controller::connect(&machine);
    controller.run(&mut machine, Duration::from_secs(5)).unwrap();
    wait_for_prompt(&mut machine);
    set_up(&mut machine, &["port ecat ethercat line P1"]);
    controller.bring_to_op(&mut machine).unwrap();
    println!("{}", machine.type_line("show version").unwrap());
    assert_eq!(controller.violations(), [""; 0]);
}
