//! The text that is saved and the one before it, with who saved them.

use embassy_futures::block_on;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use mobgate::hal::Store;
use mobgate_clock as _;
use mobgate_flash::{FlashStore, Image, SharedStore, text_bytes_max};
use mobgate_simulator::flash::{SimFlash, Torn};
use mobgate_simulator::power_cuts::{read, save, text};
use mobgate_simulator::random::Random;

type Flash = SimFlash<32, { 8 * 1024 }>;

fn open(flash: &Flash) -> FlashStore<Flash> {
    block_on(FlashStore::open(flash.clone(), 0, Image::ONLY))
}

fn save_as(store: &mut impl Store, who: &str, text: &[u8]) -> bool {
    store.sign(&who);
    save(store, text).is_ok()
}

/// Who saved each version, and its text.
fn versions(store: &mut impl Store) -> Vec<(String, Vec<u8>)> {
    (0..)
        .map_while(|nth| {
            let mut told = String::new();
            store.write_version(nth, &mut told)?.unwrap();
            let (mut text, mut chunk) = (Vec::new(), [0; 100]);
            loop {
                let count = block_on(store.read_version(nth, text.len(), &mut chunk)).unwrap();
                if count == 0 {
                    return Some((told, text));
                }
                text.extend_from_slice(&chunk[..count]);
            }
        })
        .collect()
}

fn version(who: &str, text: &[u8]) -> (String, Vec<u8>) {
    (format!("-\t-\t{who}"), text.to_owned())
}

#[test]
fn the_last_two_texts_are_known_with_who_saved_them_also_after_a_restart() {
    let flash = Flash::new(2, 1);
    let store = Mutex::<NoopRawMutex, _>::new(open(&flash));
    let mut console = SharedStore::new(&store);
    assert_eq!(versions(&mut console), []);
    assert!(save_as(&mut console, "local console", b"one"));
    assert_eq!(versions(&mut console), [version("local console", b"one")]);
    // A name that is too long is left out.
    assert!(save_as(&mut console, &"a".repeat(60), b"two"));
    // Nobody has signed this.
    assert!(save(&mut SharedStore::new(&store), b"three").is_ok());
    let expected = [version("", b"three"), version("", b"two")];
    let mut restarted = open(&flash);
    assert_eq!((versions(&mut console), versions(&mut restarted)), (expected.to_vec(), expected.to_vec()));
    assert!(save_as(&mut restarted, "anna@10.0.2.2", b""));
    assert_eq!(versions(&mut open(&flash)), [version("anna@10.0.2.2", b""), version("", b"three")]);
}

#[test]
fn after_a_cut_at_any_step_each_version_is_whole_and_the_first_one_is_the_text() {
    let (old, new) = (text(text_bytes_max::<Flash>() / 2, 1), text(700, 2));
    let before = Flash::new(2, 3);
    (0..3).for_each(|nth| assert!(save_as(&mut open(&before), "zero", &text(900, 10 + nth))));
    assert!(save_as(&mut open(&before), "old", &old));
    let whole = before.copy(4);
    assert!(save_as(&mut open(&whole), "new", &new));
    let (mut random, mut seen) = (Random::new(5), [0; 2]);
    for cut in 0..=whole.steps() - before.steps() {
        for torn in Torn::ALL {
            let flash = before.copy(random.bits());
            flash.cut_after(cut, torn);
            save_as(&mut open(&flash), "new", &new);
            flash.power_on();
            let mut store = open(&flash);
            let (valid, versions) = (read(&mut store).unwrap(), versions(&mut store));
            let is_new = valid == new;
            seen[usize::from(is_new)] += 1;
            let expected = if is_new { version("new", &new) } else { version("old", &old) };
            assert_eq!(versions.first(), Some(&expected), "cut {cut}, {torn:?}");
            let before = versions.get(1);
            let is_known = |version: &(String, Vec<u8>)| match is_new {
                true => version.1 == old,
                // The save may not have begun to overwrite it, or have written all but the head.
                false => version.1 == text(900, 12) || version.1 == new,
            };
            assert!(before.is_none_or(is_known), "cut {cut}, {torn:?}: {before:?}");
        }
    }
    assert!(seen.iter().all(|count| *count > 0), "{seen:?}");
}
