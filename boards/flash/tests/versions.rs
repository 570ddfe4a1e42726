//! The last texts that were saved, with who saved them and when.

use embassy_futures::block_on;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash};
use mobgate::hal::{Store, StoreError};
use mobgate_clock as _;
use mobgate_flash::{FlashStore, Image, SharedStore, text_bytes_max};
use mobgate_simulator::flash::{SimFlash, Torn};
use mobgate_simulator::power_cuts::{read, read_version, save, save_as, text, versions};
use mobgate_simulator::random::Random;

type Flash = SimFlash<32, { 16 * 1024 }>;

/// Microseconds of 2026-11-25T21:40:02Z.
const TIME: u64 = 1_795_642_802_000_000;

fn open<F: NorFlash + Clone>(flash: &F) -> FlashStore<F> {
    block_on(FlashStore::open(flash.clone(), 0, Image::ONLY))
}

fn version(who: &str, text: &[u8]) -> (String, Vec<u8>) {
    (format!("-\t-\t{who}"), text.to_owned())
}

#[test]
fn texts_are_known_with_who_saved_them_and_when_also_after_a_restart() {
    let flash = Flash::new(2, 1);
    let store = Mutex::<NoopRawMutex, _>::new(open(&flash));
    let mut console = SharedStore::new(&store);
    assert_eq!(versions(&mut console), []);
    save_as(&mut console, ("local console", None), b"one").unwrap();
    assert_eq!(versions(&mut console), [version("local console", b"one")]);
    // A name that is too long is left out.
    save_as(&mut console, (&"a".repeat(60), None), b"two").unwrap();
    // Nobody has signed this.
    save(&mut SharedStore::new(&store), b"three").unwrap();
    let expected = [version("", b"three"), version("", b"two"), version("local console", b"one")];
    let mut restarted = open(&flash);
    assert_eq!((versions(&mut console), versions(&mut restarted)), (expected.to_vec(), expected.to_vec()));
    save_as(&mut restarted, ("anna@10.0.2.2", Some(TIME)), b"").unwrap();
    let newest = ("2026-11-25T21:40:02Z\t-\tanna@10.0.2.2".to_owned(), Vec::new());
    assert_eq!(versions(&mut open(&flash)), [&[newest][..], &expected].concat());
}

#[test]
fn the_last_ten_are_kept_and_other_numbers_name_none() {
    let flash = Flash::new(2, 2);
    let names: Vec<_> = (0..25).map(|nth| format!("anna{nth}")).collect();
    for (nth, who) in names.iter().enumerate() {
        save_as(&mut open(&flash), (who, None), who.as_bytes()).unwrap();
        let expected: Vec<_> =
            names[..=nth].iter().rev().take(10).map(|who| version(who, who.as_bytes())).collect();
        assert_eq!(versions(&mut open(&flash)), expected, "save {nth}");
    }
    let mut store = open(&flash);
    for nth in [10, 11, 255, usize::MAX] {
        assert!(store.write_version(nth, &mut String::new()).is_none());
        assert_eq!(block_on(store.read_version(nth, 0, &mut [0; 8])), Ok(0));
    }
}

/// The numbers are those of docs/firmware.md: 102 pieces of 1022 bytes, in the sectors of the H743 and the emulated board.
#[test]
fn long_texts_leave_room_for_fewer_versions() {
    // The last one is the longest text of a board, which has no paths.
    for (bytes, expected) in [(10_000, 10), (11_000, 9), (20_000, 5), (51_921, 2)] {
        let flash = SimFlash::<32, { 128 * 1024 }>::new(2, 3);
        let mut store = open(&flash);
        let texts: Vec<_> = (0..=expected).map(|seed| text(bytes, seed)).collect();
        texts.iter().for_each(|text| save(&mut store, text).unwrap());
        let kept = versions(&mut store);
        assert!(kept.iter().map(|(_, text)| text).eq(texts[1..].iter().rev()), "{bytes}: {}", kept.len());
    }
}

/// What is in the flash is moved with each full sector: so few places are used where texts are short.
#[test]
fn a_sector_takes_many_saves_of_short_settings() {
    let flash = SimFlash::<32, { 128 * 1024 }>::new(2, 7);
    let mut store = open(&flash);
    let erased = |flash: &SimFlash<32, { 128 * 1024 }>| {
        let mut mark = [0; 32];
        // The word of the map behind the marks: set while the sector is in use.
        block_on(flash.clone().read(64, &mut mark)).unwrap();
        mark == [0xff; 32]
    };
    let (mut changes, mut was) = (0, erased(&flash));
    for seed in 0..150 {
        save(&mut store, &text(2_000, seed)).unwrap();
        let is = erased(&flash);
        changes += usize::from(is != was);
        was = is;
    }
    assert!((3..=7).contains(&changes), "{changes} sectors were filled by 150 saves");
}

#[test]
fn the_longest_text_always_fits_and_the_one_before_it_is_kept() {
    let flash = Flash::new(2, 4);
    let most = text_bytes_max::<Flash>();
    for nth in 0..30 {
        // In between, ten short ones.
        let lengths = if nth % 15 < 10 { 10 + nth } else { most };
        let mut store = open(&flash);
        let before = read(&mut store).unwrap();
        save_as(&mut store, ("anna", None), &text(lengths, nth as u64)).unwrap();
        let kept = versions(&mut open(&flash));
        assert_eq!(kept[0], version("anna", &text(lengths, nth as u64)), "save {nth}");
        assert!(nth == 0 || kept[1] == version("anna", &before), "save {nth}");
    }
}

#[test]
fn a_text_that_is_given_up_costs_the_oldest_versions_only() {
    let flash = Flash::new(2, 5);
    let mut store = open(&flash);
    let texts: Vec<_> = (0..4).map(|seed| text(3 * 1022, seed)).collect();
    texts.iter().for_each(|text| save_as(&mut store, ("anna", None), text).unwrap());
    let all: Vec<_> = texts.iter().rev().map(|text| version("anna", text)).collect();
    assert_eq!(versions(&mut store), all);
    let most = text_bytes_max::<Flash>();
    assert_eq!(save(&mut store, &vec![b'x'; most + 1]), Err(StoreError::Full(most)));
    assert_eq!(versions(&mut store), all[..2]);
    assert_eq!(versions(&mut open(&flash)), all[..2], "also after a restart");
    assert_eq!(read(&mut store).unwrap(), texts[3]);
}

#[test]
fn a_version_with_a_corrupt_word_cannot_be_read_and_the_others_can() {
    let flash = Flash::new(2, 6);
    let mut store = open(&flash);
    let all: Vec<_> = (0..4).map(|seed| version("anna", &text(1500, seed))).rev().collect();
    all.iter().rev().for_each(|(_, text)| save_as(&mut store, ("anna", None), text).unwrap());
    let mut bytes = vec![0; flash.capacity()];
    block_on(flash.clone().read(0, &mut bytes)).unwrap();
    let mut fewer = 0;
    // Behind the marks of the sector and the map's own word.
    for at in (96..flash.capacity()).step_by(32).filter(|&at| bytes[at..at + 32] != [0xff; 32]) {
        let flash = flash.copy(at as u64);
        block_on(flash.clone().write(at as u32, &[0; 32])).unwrap();
        let mut store = open(&flash);
        // The head or the valid text may be hit: then the settings are corrupt, or those of an older head.
        let Ok(valid) = read(&mut store) else { continue };
        assert_eq!(read_version(&mut store, 0), Ok(valid.clone()), "word {at:#x}");
        let mut corrupt = 0;
        for nth in 0..4 {
            let mut told = String::new();
            let Some(Ok(())) = store.write_version(nth, &mut told) else { continue };
            match read_version(&mut store, nth) {
                // The list may be hit: then it is that of an older save, and nobody is known to have saved the valid one.
                Ok(text) => {
                    let is_nobodys = told == "-\t-\t" && text == valid;
                    assert!(is_nobodys || all.contains(&(told, text)), "word {at:#x}");
                }
                Err(error) => {
                    assert_eq!(error, StoreError::Corrupt, "word {at:#x}");
                    corrupt += 1;
                }
            }
        }
        fewer += usize::from(corrupt == 1);
    }
    assert!(fewer > 90, "{fewer}: most words are those of the three older texts");
}

#[test]
fn after_a_cut_at_any_step_each_version_is_whole_and_the_first_one_is_the_text() {
    let before = Flash::new(2, 3);
    let mut history: Vec<_> = (0..4).map(|seed| text(2000, seed)).collect();
    history.push(text(text_bytes_max::<Flash>() / 2, 11));
    for text in &history {
        save_as(&mut open(&before), ("anna", None), text).unwrap();
    }
    let new = text(4000, 12);
    let whole = before.copy(4);
    save_as(&mut open(&whole), ("anna", None), &new).unwrap();
    history.push(new.clone());
    let (mut random, mut seen) = (Random::new(5), [0; 2]);
    for cut in 0..=whole.steps() - before.steps() {
        for torn in Torn::ALL {
            let flash = before.copy(random.bits());
            flash.cut_after(cut, torn);
            let _ = save_as(&mut open(&flash), ("anna", None), &new);
            flash.power_on();
            let mut store = open(&flash);
            let (valid, versions) = (read(&mut store).unwrap(), versions(&mut store));
            let is_new = valid == new;
            seen[usize::from(is_new)] += 1;
            let saved = &history[..history.len() - usize::from(!is_new)];
            let expected = saved.iter().rev().take(versions.len()).map(|text| version("anna", text));
            assert!(expected.eq(versions.iter().cloned()), "cut {cut}, {torn:?}");
            assert!(versions.len() > 1, "cut {cut}, {torn:?}: the one before was not in the way");
        }
    }
    assert!(seen.iter().all(|count| *count > 0), "{seen:?}");
}
