//! The boards' images, as they are built, in the emulator.

use std::time::Duration;

use mobgate_stm32_emulator::{Board, CONSOLE, Machine, Uart};

mod chips;
mod clients;
mod console;
mod drive;
mod ends;
mod ethercat;
#[expect(dead_code, reason = "no figure here has a least value")]
#[path = "../../../../benches/figures/figure.rs"]
mod figure;
mod firmware;
mod lines;
mod memory;
mod network;
mod passing;
mod power;
mod sb;
mod settings;
mod update_file;
mod updates;
mod users;
mod web;
mod without_ethercat;
mod ymodem;

/// Makes a test of each function for each board.
macro_rules! on_each_board {
    ($($test:ident),* $(,)?) => {
        on_each_board!(@ f429zi, NUCLEO_F429ZI, $($test),*);
        on_each_board!(@ f767zi, NUCLEO_F767ZI, $($test),*);
        on_each_board!(@ h743zi, NUCLEO_H743ZI, $($test),*);
    };
    (@ $board:ident, $which:ident, $($test:ident),*) => {
        mod $board {
            $(
                #[test]
                fn $test() {
                    super::$test(mobgate_stm32_emulator::$which);
                }
            )*
        }
    };
}
pub(crate) use on_each_board;

/// A board that has started and shows its prompt.
fn started(board: Board) -> Machine {
    let mut machine = Machine::new(board).unwrap();
    wait_for_prompt(&mut machine);
    machine
}

/// The first start erases both sectors.
fn wait_for_prompt(machine: &mut Machine) {
    let prompt = machine.wait_for_prompt(Duration::from_secs(8));
    assert!(prompt.is_ok(), "{}", prompt.unwrap_err());
    assert!(machine.format(Uart::Console).baud.abs_diff(CONSOLE.baud) < CONSOLE.baud / 50);
}

/// Types these lines, which nothing may be said to.
fn set_up(machine: &mut Machine, lines: &[&str]) {
    for line in lines {
        let shown = machine.type_line(line).unwrap();
        assert_eq!(shown, "", "{line}");
    }
}
