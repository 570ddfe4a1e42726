//! What is left of the memory.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Network};

use crate::network::{BOARD, SETTINGS, STATION};
use crate::{on_each_board, set_up, started};

on_each_board!(the_stack_has_room);

/// Bytes that are never touched.
pub(crate) const ROOM_BYTES: usize = 2048;

fn the_stack_has_room(board: Board) {
    let mut machine = started(board);
    set_up(&mut machine, SETTINGS);
    Network::new(STATION).connect(&mut machine, BOARD, 502).unwrap();
    for line in ["help", "show config", "show stats", "show network", "save"] {
        machine.type_line(line).unwrap();
    }
    machine.run(Duration::from_secs(2)).unwrap();
    let (free, all) = machine.stack_free();
    println!("{}: {} of {all} bytes of the stack were used", board.name, all - free);
    assert!(free >= ROOM_BYTES, "{free} of {all}");
}
