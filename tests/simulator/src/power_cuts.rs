//! Texts in a store, with a cut of the power at every step of a save, and what the next start finds.

use embassy_futures::block_on;
use mobgate::hal::{Store, StoreError};

use crate::flash::{SimFlash, Torn};
use crate::random::Random;

/// What a sweep found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Cuts tried.
    pub cuts: u64,
    /// Starts that found the old text.
    pub old: u64,
    /// Starts that found the new text.
    pub new: u64,
    /// Starts that found anything else, or the old text after the save was said to be done.
    pub garbage: u64,
    /// Stores that could not be saved to after that.
    pub stuck: u64,
}

/// Saves `new` over `old`, with a cut at each step, also behind the last, and for each [`Torn`], and a second cut during the start after it.
///
/// `open` opens the store in a flash, as at a start. `saves` is how many texts were saved before.
pub fn sweep<S: Store, const WORD: usize, const SECTOR: usize>(
    open: impl AsyncFn(SimFlash<WORD, SECTOR>) -> S,
    saves: usize,
    (old, new): (&[u8], &[u8]),
    seed: u64,
) -> Tally {
    let start = |flash: &SimFlash<WORD, SECTOR>| block_on(open(flash.clone()));
    let mut random = Random::new(seed);
    let before = SimFlash::new(2, seed);
    for nth in 0..saves {
        let text = text(old.len(), nth as u64);
        save(&mut start(&before), &text).expect("a save without a cut");
    }
    save(&mut start(&before), old).expect("a save without a cut");
    let whole = before.copy(seed);
    save(&mut start(&whole), new).expect("a save without a cut");

    let mut tally = Tally::default();
    for cut in 0..=whole.steps() - before.steps() {
        for torn in Torn::ALL {
            let flash = before.copy(random.bits());
            flash.cut_after(cut, torn);
            let done = save(&mut start(&flash), new).is_ok();
            flash.cut_after(random.within(0..=2), Torn::ALL[random.index(Torn::ALL.len())]);
            // This start ends by a cut, or not.
            let _ = read(&mut start(&flash));
            flash.power_on();
            tally.cuts += 1;
            match read(&mut start(&flash)) {
                Ok(text) if text == new => tally.new += 1,
                Ok(text) if text == old && !done => tally.old += 1,
                _ => tally.garbage += 1,
            }
            let next = text(new.len(), cut);
            let saved = save(&mut start(&flash), &next);
            tally.stuck += u64::from(saved.is_err() || read(&mut start(&flash)) != Ok(next));
        }
    }
    tally
}

/// A text of `length` bytes that no other `seed` gives.
pub fn text(length: usize, seed: u64) -> Vec<u8> {
    let mut random = Random::new(seed);
    (0..length).map(|_| random.byte()).collect()
}

/// Saves `text` in lines of some length, as settings are.
pub fn save(store: &mut impl Store, text: &[u8]) -> Result<(), StoreError> {
    block_on(async {
        for line in text.chunks(61) {
            store.append(line).await?;
        }
        store.commit().await
    })
}

/// All of the text that `store` has.
pub fn read(store: &mut impl Store) -> Result<Vec<u8>, StoreError> {
    whole::<64>(|offset, into| block_on(store.read(offset, into)))
}

/// All of a text that `read` gives from an offset on, some bytes at a time.
fn whole<const BYTES: usize>(
    mut read: impl FnMut(usize, &mut [u8]) -> Result<usize, StoreError>,
) -> Result<Vec<u8>, StoreError> {
    let (mut text, mut chunk) = (Vec::new(), [0; BYTES]);
    loop {
        match read(text.len(), &mut chunk)? {
            0 => return Ok(text),
            count => text.extend_from_slice(&chunk[..count]),
        }
    }
}

/// Saves `text` as `who` does it at a time: microseconds since 1970, if it is known.
pub fn save_as(
    store: &mut impl Store,
    (who, at): (&str, Option<u64>),
    text: &[u8],
) -> Result<(), StoreError> {
    store.sign(&who, || at);
    save(store, text)
}

/// The text of version `nth`.
pub fn read_version(store: &mut impl Store, nth: usize) -> Result<Vec<u8>, StoreError> {
    whole::<700>(|offset, into| block_on(store.read_version(nth, offset, into)))
}

/// What `store` tells of each version, and its text.
pub fn versions(store: &mut impl Store) -> Vec<(String, Vec<u8>)> {
    let row = |nth| {
        let mut told = String::new();
        store.write_version(nth, &mut told)?.expect("a row");
        Some((told, read_version(store, nth).expect("a text that is whole")))
    };
    (0..).map_while(row).collect()
}
