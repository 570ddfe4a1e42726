//! Settings in the chip's flash.

use mobgate_stm32_emulator::Board;

use crate::{on_each_board, set_up, started, wait_for_prompt};

on_each_board!(saved_settings_outlive_a_loss_of_power_and_unsaved_ones_do_not);

fn saved_settings_outlive_a_loss_of_power_and_unsaved_ones_do_not(board: Board) {
    let mut machine = started(board);
    set_up(&mut machine, &["port P1 serial uart1 rtu client 9600 8E1"]);
    assert_eq!(machine.type_line("save").unwrap().trim(), "saved");
    set_up(&mut machine, &["port P2 serial uart2 rtu client 9600 8E1"]);
    machine.power_cycle();
    wait_for_prompt(&mut machine);
    let config = machine.type_line("show config").unwrap();
    assert!(config.contains("port P1 serial uart1 rtu client 9600 8E1"), "{config}");
    assert!(!config.contains("uart2 rtu client 9600"), "{config}");
    let log = machine.type_line("show log").unwrap();
    assert!(!log.contains("settings:"), "{log}");
}
