//! The smaller images, without EtherCAT and data points.

use mobgate_stm32_emulator::Board;

use crate::clients::as_many_clients_as_the_board_has_are_served_at_a_time;
use crate::{on_each_board, started};

on_each_board!(
    the_smaller_image_starts_and_says_that_it_has_no_ethercat,
    the_smaller_image_serves_as_many_clients
);

fn the_smaller_image_starts_and_says_that_it_has_no_ethercat(board: Board) {
    let mut machine = started(board.without_ethercat());
    let version = machine.type_line("show version").unwrap();
    let name = board.name.to_uppercase().replace('_', "-");
    assert!(version.contains(&name) && !version.contains("EtherCAT"), "{version}");
    let refused = machine.type_line("port ecat ethercat").unwrap();
    assert!(refused.starts_with("error: "), "{refused}");
}

fn the_smaller_image_serves_as_many_clients(board: Board) {
    as_many_clients_as_the_board_has_are_served_at_a_time(board.without_ethercat());
}
