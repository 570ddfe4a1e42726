//! Power cuts in the middle of what is done to the flash.

use mobgate_stm32_emulator::{Board, Machine};

use crate::{on_each_board, set_up, started, wait_for_prompt};

on_each_board!(
    a_power_cut_at_any_operation_of_a_save_leaves_the_old_or_the_new_settings,
    a_power_cut_at_any_operation_of_the_first_start_leaves_a_board_that_saves,
);

/// The settings that the board started with.
fn baud(machine: &mut Machine) -> String {
    let config = machine.type_line("show config").unwrap();
    let line = config.lines().find(|line| line.starts_with("port P1 ")).unwrap_or_default();
    line.trim().to_owned()
}

fn set(machine: &mut Machine, baud: u32) -> String {
    let line = format!("port P1 serial uart1 rtu client {baud} 8E1");
    set_up(machine, &[&line]);
    line
}

fn a_power_cut_at_any_operation_of_a_save_leaves_the_old_or_the_new_settings(board: Board) {
    let mut machine = started(board);
    let mut old = set(&mut machine, 9600);
    assert_eq!(machine.type_line("save").unwrap().trim(), "saved");
    let (mut bauds, mut kept) = ([19200, 9600].into_iter().cycle(), [0, 0]);
    for operation in 0.. {
        let new = set(&mut machine, bauds.next().unwrap());
        machine.cut_power_at(operation);
        let saved = machine.type_line("save");
        machine.keep_power();
        if saved.is_ok_and(|said| said.trim() == "saved") {
            assert!(operation > 2, "a save has more operations than {operation}");
            break;
        }
        machine.power_cycle();
        wait_for_prompt(&mut machine);
        let is = baud(&mut machine);
        assert!(is == old || is == new, "operation {operation}: {is:?} is neither {old:?} nor {new:?}");
        kept[usize::from(is == new)] += 1;
        // And saving works.
        old = new;
        set_up(&mut machine, &[&old]);
        assert_eq!(
            machine.type_line("save").unwrap().trim(),
            "saved",
            "after a cut at operation {operation}"
        );
    }
    assert!(kept[0] > 0, "no cut was before the moment that decides: {kept:?}");
}

fn a_power_cut_at_any_operation_of_the_first_start_leaves_a_board_that_saves(board: Board) {
    let mut machine = Machine::new(board).unwrap();
    machine.soil_flash();
    wait_for_prompt(&mut machine);
    let operations = machine.flash_operations();
    assert!(operations > 2, "{operations}");
    for operation in 0..operations {
        let mut machine = Machine::new(board).unwrap();
        machine.soil_flash();
        machine.cut_power_at(operation);
        assert!(machine.wait_for_prompt(std::time::Duration::from_secs(8)).is_err());
        machine.power_cycle();
        wait_for_prompt(&mut machine);
        let line = set(&mut machine, 9600);
        assert_eq!(
            machine.type_line("save").unwrap().trim(),
            "saved",
            "after a cut at operation {operation}"
        );
        machine.power_cycle();
        wait_for_prompt(&mut machine);
        assert_eq!(baud(&mut machine), line);
    }
}
