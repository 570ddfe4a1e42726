//! How a run ends that should not, and what the next one says of it.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, Reset};

use crate::{on_each_board, started, wait_for_prompt};

on_each_board!(
    the_watchdog_ends_a_run_that_hangs,
    a_fault_is_written_down_and_the_board_starts_again,
    a_panic_is_written_down_with_the_calls_that_led_to_it,
    an_interrupt_that_nobody_serves_is_written_down,
);

fn the_watchdog_ends_a_run_that_hangs(board: Board) {
    let mut machine = started(board);
    machine.hang_phy(true);
    let from = machine.now();
    while machine.resets.is_empty() {
        machine.run(Duration::from_millis(100)).unwrap();
        assert!(machine.now() - from < Duration::from_secs(12), "no reset");
    }
    // It was fed within the last second.
    assert!(machine.now() - from > Duration::from_secs(9), "{:?}", machine.now() - from);
    assert_eq!(machine.resets, [Reset::Watchdog]);
    machine.hang_phy(false);
    wait_for_prompt(&mut machine);
    let log = machine.type_line("show log").unwrap();
    assert!(log.contains("board: started by the watchdog"), "{log}");
}

fn a_fault_is_written_down_and_the_board_starts_again(board: Board) {
    let mut machine = started(board);
    machine.mislead(0x6000_0000);
    wait_for_prompt(&mut machine);
    assert_eq!(machine.resets, [Reset::Software]);
    let log = machine.type_line("show log").unwrap();
    assert!(log.contains("board: started by reboot or after a fault"), "{log}");
    assert!(log.contains("the last run ended: fault 0x00000100 at 0x60000000"), "{log}");
    // Once only.
    machine.type_line("reboot").unwrap();
    assert_eq!(machine.resets, [Reset::Software; 2]);
    let log = machine.type_line("show log").unwrap();
    assert!(!log.contains("the last run ended"), "{log}");
}

fn a_panic_is_written_down_with_the_calls_that_led_to_it(board: Board) {
    let mut machine = started(board);
    let call = machine.panic();
    wait_for_prompt(&mut machine);
    assert_eq!(machine.resets, [Reset::Software]);
    let log = machine.type_line("show log").unwrap();
    // What is wider than the terminal goes on below.
    let log = log.split_whitespace().collect::<Vec<_>>().join(" ");
    let (_, words) = log.split_once("the last run ended: panic after calls at ").expect(&log);
    let calls: Vec<&str> = words.split(' ').take_while(|word| word.starts_with("0x")).collect();
    // The handler's, the one that was met, and that of the function where the program was.
    assert_eq!(calls.get(1), Some(&&*format!("{:#010x}", call + 2)), "{log}");
    assert!((3..=12).contains(&calls.len()), "{log}");
}

fn an_interrupt_that_nobody_serves_is_written_down(board: Board) {
    let mut machine = started(board);
    machine.raise_nmi();
    wait_for_prompt(&mut machine);
    let log = machine.type_line("show log").unwrap();
    assert!(log.contains("the last run ended: interrupt -14, which nobody serves"), "{log}");
}
