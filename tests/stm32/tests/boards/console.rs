//! What a person at the terminal sees.

use mobgate_stm32_emulator::Board;

use crate::{on_each_board, started};

on_each_board!(the_console_responses, a_wrong_line_is_named);

fn the_console_responses(board: Board) {
    let mut machine = started(board);
    let version = machine.type_line("show version").unwrap();
    let name = board.name.to_uppercase().replace('_', "-");
    assert!(version.contains(&name), "{version}");
    let log = machine.type_line("show log").unwrap();
    assert!(log.contains("board: started by power"), "{log}");
}

fn a_wrong_line_is_named(board: Board) {
    let mut machine = started(board);
    let said = machine.type_line("prot P9").unwrap();
    assert!(said.contains("did you mean port?"), "{said}");
}
