//! Saves, saves that are given up or do not fit, and restarts in any order: the versions are those of a list with a budget. The ring may
//! begin anew where half of it was used, so there are at least those of half the budget.

use embassy_futures::block_on;
use mobgate::hal::{Store, StoreError};
use mobgate_clock as _;
use mobgate_flash::{FlashStore, Image};
use mobgate_simulator::flash::SimFlash;
use mobgate_simulator::power_cuts::{read, save_as, text, versions};
use mobgate_simulator::random::Random;

type Flash = SimFlash<32, { 16 * 1024 }>;

/// Bytes of a piece, and pieces that such a sector has room for.
const PIECE: usize = 1022;
const BUDGET: usize = 12;
/// Longest text: half of them.
const MOST: usize = BUDGET / 2 * PIECE;

/// Texts with what is told of them, the newest first.
struct Model {
    texts: Vec<(String, Vec<u8>)>,
    budget: usize,
}

impl Model {
    /// So many pieces are written: the oldest texts give way.
    fn write(&mut self, pieces: usize) {
        let mut used = pieces;
        self.texts.retain(|(_, text)| {
            used += text.len().div_ceil(PIECE);
            used <= self.budget
        });
    }

    fn save(&mut self, told: String, text: Vec<u8>) {
        self.write(text.len().div_ceil(PIECE));
        self.texts.insert(0, (told, text));
        self.texts.truncate(10);
    }
}

fn open(flash: &Flash) -> FlashStore<Flash> {
    block_on(FlashStore::open(flash.clone(), 0, Image::ONLY))
}

fn run(seed: u64, steps: usize) -> usize {
    let mut random = Random::new(seed);
    let flash = Flash::new(2, random.bits());
    let (mut store, mut most) = (open(&flash), 0);
    let mut models = [BUDGET / 2, BUDGET].map(|budget| Model { texts: Vec::new(), budget });
    for step in 0..steps {
        let context = format!("seed {seed}, step {step}");
        // Mostly short ones.
        let pieces = [1, 1, 1, 2, BUDGET / 2][random.index(if seed.is_multiple_of(2) { 3 } else { 5 })];
        let content = text(random.within(1..=(pieces * PIECE) as u64) as usize, random.bits());
        match random.index(10) {
            0 => store = open(&flash),
            1 => {
                let written = &content[..random.index(content.len().div_ceil(61)) * 61];
                written.chunks(61).for_each(|line| block_on(store.append(line)).unwrap());
                store.forget();
                models.iter_mut().for_each(|model| model.write(written.len() / PIECE));
            }
            2 if seed % 2 == 1 => {
                let long = text(MOST + 1 + random.index(100), random.bits());
                let saved = save_as(&mut store, ("too long", None), &long);
                assert_eq!(saved, Err(StoreError::Full(MOST)), "{context}");
                models.iter_mut().for_each(|model| model.write(MOST / 61 * 61 / PIECE));
            }
            _ => {
                let told = format!("-\t-\tanna{step}");
                save_as(&mut store, (&told[4..], None), &content)
                    .unwrap_or_else(|error| panic!("{context}: {error}"));
                models.iter_mut().for_each(|model| model.save(told.clone(), content.clone()));
            }
        }
        let [least, all] = &models;
        let kept = versions(&mut store);
        assert!(all.texts.starts_with(&kept), "{context}");
        assert!(kept.starts_with(&least.texts) && kept.is_empty() == all.texts.is_empty(), "{context}");
        let valid = kept.first().map(|(_, text)| text.clone()).unwrap_or_default();
        assert!(read(&mut store).unwrap() == valid, "{context}");
        if step.is_multiple_of(16) {
            assert!(versions(&mut open(&flash)) == kept, "{context}, after a restart");
        }
        most = most.max(kept.len());
    }
    most
}

/// A failing run prints its seed; `run(SEED, STEPS)` alone replays it.
#[test]
fn versions_are_those_of_a_list_with_a_budget_whatever_is_done() {
    let most = (0..40).map(|seed| run(seed, 60)).max();
    assert_eq!(most, Some(10), "some had all that can be");
}
