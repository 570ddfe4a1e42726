//! Saves whose power is cut at every step. `cargo xtask bench power_cuts` does more of them.

use mobgate_clock as _;
use mobgate_flash::{FlashStore, Image};
use mobgate_simulator::flash::SimFlash;
use mobgate_simulator::power_cuts::{Tally, sweep, text};

/// Small, so that a few saves fill one and erase the other.
const SECTOR: usize = 8 * 1024;

fn cut<const WORD: usize>(saves: usize, old: usize, new: usize) -> Tally {
    let texts = (text(old, 1_000), text(new, 1_001));
    let open = async |flash: SimFlash<WORD, SECTOR>| FlashStore::open(flash, 0, Image::ONLY).await;
    let tally = sweep(open, saves, (&texts.0, &texts.1), (saves + old + new) as u64);
    assert!(tally.cuts > 0 && tally.new > 0 && tally.old > 0, "{tally:?}");
    assert_eq!((tally.garbage, tally.stuck), (0, 0), "{tally:?}");
    tally
}

#[test]
fn after_a_cut_at_any_step_the_text_is_the_old_or_the_new_one() {
    let steps: Vec<u64> = (2..5).map(|saves| cut::<32>(saves, 1_500, 1_600).cuts).collect();
    let (least, most) = (steps.iter().min().unwrap(), steps.iter().max().unwrap());
    assert!(most > least, "no save moved what is in a full sector: {steps:?}");
}

#[test]
fn after_a_cut_while_the_first_text_is_replaced_by_none_it_is_there_or_not() {
    cut::<4>(0, 200, 0);
}
