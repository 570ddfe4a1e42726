//! Saves whose power is cut at every step. `cargo xtask bench power_cuts` does more of them.

use embassy_futures::block_on;
use mobgate_clock as _;
use mobgate_flash::{FlashStore, Image, text_bytes_max};
use mobgate_simulator::flash::{SimFlash, Torn};
use mobgate_simulator::power_cuts::{Tally, read, save, sweep, text, versions};
use mobgate_simulator::random::Random;

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

/// Eleven saves of random lengths, each of them cut at every step: the settings are the old or the new ones, and the versions, if there
/// are any, are the last ones before in their order.
fn cut_eleven_saves(seed: u64) {
    let mut random = Random::new(seed);
    let before = SimFlash::<32, SECTOR>::new(2, random.bits());
    let open = |flash: &SimFlash<32, SECTOR>| block_on(FlashStore::open(flash.clone(), 0, Image::ONLY));
    let mut history = vec![Vec::new()];
    for nth in 0..11 {
        let most = [300, text_bytes_max::<SimFlash<32, SECTOR>>() as u64][random.index(2)];
        let new = text(random.within(1..=most) as usize, random.bits());
        let whole = before.copy(random.bits());
        save(&mut open(&whole), &new).unwrap();
        history.push(new);
        for cut in 0..whole.steps() - before.steps() {
            let torn = Torn::ALL[random.index(Torn::ALL.len())];
            let context = format!("seed {seed}, save {nth}, cut {cut}, {torn:?}");
            let flash = before.copy(random.bits());
            flash.cut_after(cut, torn);
            save(&mut open(&flash), &history[nth + 1]).unwrap_err();
            flash.power_on();
            let mut store = open(&flash);
            let valid = read(&mut store).unwrap_or_else(|error| panic!("{context}: {error}"));
            let saved = history[..nth + 2].iter().rposition(|text| *text == valid);
            let saved =
                saved.filter(|saved| *saved >= nth).unwrap_or_else(|| panic!("{context}: older settings"));
            let expected = history[1..=saved].iter().rev();
            let kept = versions(&mut store);
            assert!(kept.iter().map(|(_, text)| text).eq(expected.take(kept.len())), "{context}");
            assert!(kept.is_empty() != (cfg!(feature = "versions") && saved > 0), "{context}");
            save(&mut store, b"next").unwrap();
            assert_eq!(read(&mut open(&flash)).unwrap(), b"next", "{context}");
        }
        save(&mut open(&before), &history[nth + 1]).unwrap();
    }
}

/// A failing run prints its seed; `cut_eleven_saves(SEED)` alone replays it.
#[test]
fn after_a_cut_at_any_step_of_eleven_saves_versions_are_whole_or_gone() {
    (0..4).for_each(cut_eleven_saves);
}
