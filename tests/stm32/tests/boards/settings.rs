//! Settings in the chip's flash.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Machine};

use crate::{on_each_board, set_up, started, wait_for_prompt};

on_each_board!(
    saved_settings_outlive_a_loss_of_power_and_unsaved_ones_do_not,
    time_goes_on_while_sectors_are_erased,
);

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

fn time_goes_on_while_sectors_are_erased(board: Board) {
    let mut machine = Machine::new(board).unwrap();
    machine.soil_flash();
    // Both sectors are erased, which takes 2 to 4 s, and the program stands still meanwhile on an F7.
    wait_for_prompt(&mut machine);
    machine.run(Duration::from_secs(5)).unwrap();
    let seconds = machine.now().as_secs();
    let version = machine.type_line("show version").unwrap();
    assert!(version.contains(&format!("up {seconds}s")), "{version} after {:?}", machine.now());
}
