//! What older revisions of the chips need, and that a run is the same each time.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, CONSOLE, Machine, NUCLEO_F429ZI, NUCLEO_F767ZI, NUCLEO_H743ZI, Uart};

use crate::{on_each_board, set_up, started, wait_for_prompt};

on_each_board!(a_run_is_the_same_each_time, instructions_are_cached_and_data_are_not);

fn a_run_is_the_same_each_time(board: Board) {
    let run = || {
        let mut machine = started(board);
        let shown = machine.type_line("help").unwrap();
        (machine.now(), machine.instructions(), shown)
    };
    assert_eq!(run(), run());
}

/// So DMA and the program see the same everywhere, without maintenance.
fn instructions_are_cached_and_data_are_not(board: Board) {
    assert_eq!(started(board).caches(), (true, false));
}

/// Revision Y.
const H743_Y: u16 = 0x1003;
/// Revision A.
const F429_A: u16 = 0x1000;

#[test]
fn an_h743_of_revision_y_reads_its_memory_for_one_master_at_a_time() {
    let mut machine = Machine::new(NUCLEO_H743ZI).unwrap();
    machine.set_revision(H743_Y);
    wait_for_prompt(&mut machine);
    assert!(machine.reads_for_one_master());
    assert!(!started(NUCLEO_H743ZI).reads_for_one_master());
}

#[test]
fn an_f767_whose_flash_is_two_banks_says_what_to_do() {
    let mut machine = Machine::new(NUCLEO_F767ZI).unwrap();
    machine.split_flash();
    // Longer than the watchdog waits.
    let said = machine.receive(Uart::Console, usize::MAX, Duration::from_secs(12)).unwrap();
    let format = said[0].character.format;
    assert!(format.baud.abs_diff(CONSOLE.baud) < CONSOLE.baud / 50 && format.parity == CONSOLE.parity);
    let said: String = said.iter().map(|sent| char::from(sent.character.data)).collect();
    let line = "mobgate needs this chip's flash in one bank: STM32_Programmer_CLI -c port=SWD -ob nDBANK=1, then flash it anew\r\n";
    assert!(said.matches(line).count() > 3, "{said:?}");
    assert_eq!(machine.resets, []);
}

#[test]
fn an_f429_of_revision_a_keeps_its_settings() {
    let mut machine = Machine::new(NUCLEO_F429ZI).unwrap();
    machine.set_revision(F429_A);
    wait_for_prompt(&mut machine);
    let line = "port P1 serial uart1 rtu client 9600 8E1";
    set_up(&mut machine, &[line]);
    assert_eq!(machine.type_line("save").unwrap().trim(), "saved");
    machine.power_cycle();
    wait_for_prompt(&mut machine);
    assert!(machine.type_line("show config").unwrap().contains(line));
}
