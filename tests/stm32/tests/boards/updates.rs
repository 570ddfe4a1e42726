//! The boot loader: what it starts, swaps and swaps back, with power cuts in between.

use std::hash::{DefaultHasher, Hash, Hasher};

use mobgate_stm32_emulator::{Board, Machine, Stop};

use crate::firmware::START_MAX;
use crate::{on_each_board, set_up, started, wait_for_prompt};

on_each_board!(
    an_image_that_waits_is_swapped_in_and_one_that_is_not_confirmed_goes_back,
    an_image_that_faults_at_its_start_goes_back,
    power_cuts_at_erasures_and_words_of_the_swap_and_of_the_way_back_leave_a_whole_image,
);

fn name(board: Board) -> String {
    board.name.to_uppercase().replace('_', "-")
}

/// The program with another name of the board, by which it is known.
fn renamed(program: &[u8], board: Board) -> Vec<u8> {
    let (name, mut renamed) = (name(board), program.to_vec());
    let at = |bytes: &[u8]| bytes.windows(name.len()).position(|window| window == name.as_bytes());
    while let Some(at) = at(&renamed) {
        renamed[at + name.len() - 1] = b'X';
    }
    assert_ne!(renamed, program);
    renamed
}

fn runs(machine: &mut Machine, name: &str) {
    let version = machine.type_line("show version").unwrap();
    assert!(version.contains(name), "{version}");
}

fn an_image_that_waits_is_swapped_in_and_one_that_is_not_confirmed_goes_back(board: Board) {
    let mut machine = started(board);
    let line = "port P1 serial uart1 rtu client 9600 8E1";
    set_up(&mut machine, &[line]);
    assert_eq!(machine.type_line("save").unwrap().trim(), "saved");
    let (old, new_name) = (machine.program(), name(board).replace("ZI", "ZX"));
    let new = renamed(&old, board);
    machine.stage(&new);
    machine.power_cycle();
    machine.wait_for_prompt(START_MAX).unwrap();
    runs(&mut machine, &new_name);
    assert!(machine.program() == new);
    machine.power_cycle();
    machine.wait_for_prompt(START_MAX).unwrap();
    runs(&mut machine, &name(board));
    assert!(machine.program() == old);
    assert!(machine.type_line("show config").unwrap().contains(line), "the settings are lost");
    // It stays.
    machine.power_cycle();
    wait_for_prompt(&mut machine);
    assert!(machine.program() == old);
}

fn an_image_that_faults_at_its_start_goes_back(board: Board) {
    let mut machine = started(board);
    let old = machine.program();
    let mut broken = old.clone();
    // Its reset vector leads nowhere.
    broken[4..8].copy_from_slice(&0x6000_0001_u32.to_le_bytes());
    machine.stage(&broken);
    machine.power_cycle();
    machine.wait_for_prompt(START_MAX).unwrap();
    assert!(machine.program() == old);
}

/// Starts the board with a power cut in the middle of the flash's `operation`.
fn cut(machine: &mut Machine, operation: usize) {
    machine.power_cycle();
    machine.cut_power_at(operation);
    assert_eq!(machine.run(START_MAX), Err(Stop::PowerCut), "operation {operation}");
    machine.keep_power();
}

/// Words within pages that are cut as well, on the way there and back together.
const WORDS_WITHIN: usize = 200;

/// The operations of page `nth` of `pages` that are cut between the page's first word and its last, of `words`: its share of
/// [`WORDS_WITHIN`], by `MOBGATE_SEED`. `MOBGATE_CUTS=all cargo xtask test stm32` cuts each word.
fn within(words: usize, nth: usize, pages: usize) -> Vec<usize> {
    let all = 2..words;
    if std::env::var("MOBGATE_CUTS").is_ok_and(|cuts| cuts == "all") {
        return all.collect();
    }
    let seed: u64 = std::env::var("MOBGATE_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(0);
    let chosen = |number: usize| {
        let mut hasher = DefaultHasher::new();
        (seed, nth, number).hash(&mut hasher);
        all.start + hasher.finish() as usize % all.len()
    };
    (0..WORDS_WITHIN.div_ceil(pages)).map(chosen).collect()
}

fn power_cuts_at_erasures_and_words_of_the_swap_and_of_the_way_back_leave_a_whole_image(board: Board) {
    let mut machine = started(board);
    let old = machine.program();
    let new = renamed(&old, board);
    machine.stage(&new);
    let (pages, words) = machine.pages_to_swap();
    for (way, running) in [&new, &old].into_iter().enumerate() {
        for page in 0..pages {
            // Its erasure, its first word, some of those in between, its last word.
            cut(&mut machine, 0);
            cut(&mut machine, 1);
            let within = within(words, way * pages + page, 2 * pages);
            within.into_iter().for_each(|operation| cut(&mut machine, operation));
            cut(&mut machine, words);
            // The word of the state that says it is copied. With that of the last page the new image is on trial, and a power cut ends it.
            if page + 1 < pages || running == &old {
                cut(&mut machine, words + 1);
            }
        }
        if running == &old {
            // And its end: that the progress is void, the erasure of the state.
            cut(&mut machine, 0);
            let has_ecc = machine.flash_word_bytes() > 4;
            cut(&mut machine, usize::from(!has_ecc));
        }
        machine.power_cycle();
        machine.wait_for_prompt(START_MAX).unwrap();
        assert!(machine.program() == *running);
    }
}
