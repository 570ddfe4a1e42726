//! Settings saved while an image is on trial: they are the settings once it is confirmed, and gone if it goes back.

use embassy_futures::block_on;
use mobgate::hal::StoreError;
use mobgate_clock as _;
use mobgate_flash::{FlashStore, Image};
use mobgate_simulator::Random;
use mobgate_simulator::flash::{SimFlash, Torn};
use mobgate_simulator::power_cuts::{read, save, save_as, text, versions};

type Flash = SimFlash<32, { 4 * 1024 }>;

const BEFORE: Image = Image { id: 1, confirmed: true };
const TRIAL: Image = Image { id: 2, confirmed: false };
const CONFIRMED: Image = Image { id: 2, confirmed: true };

fn open(flash: &Flash, image: Image) -> FlashStore<Flash> {
    block_on(FlashStore::open(flash.clone(), 0, image))
}

/// A flash with the settings `old`, saved by the image before.
fn with_old(seed: u64) -> Flash {
    let flash = Flash::new(2, seed);
    save(&mut open(&flash, BEFORE), b"old").unwrap();
    flash
}

#[test]
fn what_is_saved_on_trial_is_read_at_once_and_stays_when_it_is_confirmed() {
    for saves in 1..4 {
        let flash = with_old(1);
        let mut store = open(&flash, TRIAL);
        assert_eq!(read(&mut store).unwrap(), b"old");
        for nth in 0..saves {
            let text = text(700, nth);
            save(&mut store, &text).unwrap();
            assert_eq!(read(&mut store).unwrap(), text);
        }
        block_on(store.confirm()).unwrap();
        let steps = flash.steps();
        block_on(store.confirm()).unwrap();
        assert_eq!(flash.steps(), steps, "there is nothing more to confirm");
        let last = text(700, saves - 1);
        assert_eq!(read(&mut store).unwrap(), last);
        assert_eq!(read(&mut open(&flash, CONFIRMED)).unwrap(), last);
        save(&mut store, b"after").unwrap();
        assert_eq!(read(&mut open(&flash, CONFIRMED)).unwrap(), b"after", "the trial does not come back");
        // Also where a power cut came between the confirmation of the image and that of the settings.
        let flash = with_old(1);
        save(&mut open(&flash, TRIAL), &last).unwrap();
        assert_eq!(read(&mut open(&flash, CONFIRMED)).unwrap(), last);
        // And the next saves are as any.
        for nth in 10..14 {
            save(&mut open(&flash, CONFIRMED), &text(700, nth)).unwrap();
            assert_eq!(read(&mut open(&flash, CONFIRMED)).unwrap(), text(700, nth));
        }
    }
}

#[test]
fn an_image_that_went_back_leaves_the_old_settings_and_the_next_trial_begins_with_them() {
    let flash = with_old(2);
    save(&mut open(&flash, TRIAL), b"new").unwrap();
    assert_eq!(read(&mut open(&flash, BEFORE)).unwrap(), b"old");
    assert_eq!(read(&mut open(&flash, TRIAL)).unwrap(), b"old", "the same image again");
    save(&mut open(&flash, BEFORE), b"newer").unwrap();
    assert_eq!(read(&mut open(&flash, TRIAL)).unwrap(), b"newer");
}

#[test]
fn a_trial_without_a_save_changes_nothing() {
    let flash = with_old(3);
    let steps = flash.steps();
    let mut store = open(&flash, TRIAL);
    block_on(store.confirm()).unwrap();
    assert_eq!(flash.steps(), steps);
    save(&mut store, b"new").unwrap();
    assert_eq!(read(&mut open(&flash, CONFIRMED)).unwrap(), b"new");
}

#[test]
fn the_first_settings_of_all_may_be_saved_on_trial() {
    for (image, expected) in [(CONFIRMED, &b"new"[..]), (BEFORE, b"")] {
        let flash = Flash::new(2, 4);
        save(&mut open(&flash, TRIAL), b"new").unwrap();
        assert_eq!(read(&mut open(&flash, image)).unwrap(), expected);
    }
}

/// What happens with the power cut somewhere within; the images that may run afterwards, and what each of them may find.
fn sweep(
    seed: u64,
    saves_before: u64,
    mut act: impl FnMut(&Flash) -> Result<(), StoreError>,
    found: &[(Image, &[&[u8]])],
) {
    let mut random = Random::new(seed);
    let before = Flash::new(2, seed);
    for nth in 0..saves_before {
        save(&mut open(&before, BEFORE), &text(700, 100 + nth)).unwrap();
    }
    save(&mut open(&before, BEFORE), b"old").unwrap();
    let whole = before.copy(seed);
    act(&whole).unwrap();
    let mut cuts = 0;
    for cut in 0..=whole.steps() - before.steps() {
        for torn in Torn::ALL {
            let flash = before.copy(random.bits());
            flash.cut_after(cut, torn);
            let _ = act(&flash);
            flash.power_on();
            for &(image, texts) in found {
                let flash = flash.copy(random.bits());
                // A second cut, during the start.
                flash.cut_after(random.within(0..=2), Torn::ALL[random.index(Torn::ALL.len())]);
                let _ = read(&mut open(&flash, image));
                flash.power_on();
                let text =
                    read(&mut open(&flash, image)).unwrap_or_else(|error| panic!("cut {cut}: {error}"));
                assert!(texts.contains(&&*text), "cut {cut}, {torn:?}, {image:?}: {}", text.escape_ascii());
                save(&mut open(&flash, image), b"next").unwrap();
                assert_eq!(read(&mut open(&flash, image)).unwrap(), b"next", "cut {cut}, {torn:?}");
                cuts += 1;
            }
        }
    }
    assert!(cuts > 20, "{cuts}");
}

#[test]
fn a_cut_at_any_step_of_a_save_on_trial_leaves_the_old_settings_to_the_image_that_comes_back() {
    for saves in [0, 4] {
        let new = text(700, 1);
        sweep(10 + saves, saves, |flash| save(&mut open(flash, TRIAL), &new), &[(BEFORE, &[b"old"])]);
        // The second save of a trial writes over the first.
        let act = |flash: &Flash| {
            let mut store = open(flash, TRIAL);
            save(&mut store, &text(700, 2))?;
            save(&mut store, &new)
        };
        sweep(20 + saves, saves, act, &[(BEFORE, &[b"old"])]);
    }
}

#[test]
fn a_cut_at_any_step_of_a_confirmation_leaves_the_new_settings() {
    for saves in [0, 4] {
        let new = text(700, 1);
        let act = |flash: &Flash| {
            let mut store = open(flash, TRIAL);
            save(&mut store, &new)?;
            block_on(store.confirm())
        };
        sweep(30 + saves, saves, act, &[(CONFIRMED, &[b"old", &new])]);
        // Once the save is done, nothing brings the old ones back.
        let mut random = Random::new(40 + saves);
        let before = Flash::new(2, 40 + saves);
        (0..saves).for_each(|nth| save(&mut open(&before, BEFORE), &text(700, nth)).unwrap());
        save(&mut open(&before, BEFORE), b"old").unwrap();
        save(&mut open(&before, TRIAL), &new).unwrap();
        let whole = before.copy(1);
        block_on(open(&whole, TRIAL).confirm()).unwrap();
        for cut in 0..=whole.steps() - before.steps() {
            for torn in Torn::ALL {
                let flash = before.copy(random.bits());
                flash.cut_after(cut, torn);
                let _ = block_on(open(&flash, TRIAL).confirm());
                flash.power_on();
                assert_eq!(read(&mut open(&flash, CONFIRMED)).unwrap(), new, "cut {cut}, {torn:?}");
                save(&mut open(&flash, CONFIRMED), b"next").unwrap();
                assert_eq!(read(&mut open(&flash, CONFIRMED)).unwrap(), b"next", "cut {cut}, {torn:?}");
            }
        }
    }
}

#[test]
fn a_cut_at_any_step_of_the_way_back_leaves_the_old_settings() {
    let act = |flash: &Flash| {
        save(&mut open(flash, TRIAL), b"new")?;
        read(&mut open(flash, BEFORE)).map(|_| ())
    };
    sweep(50, 2, act, &[(BEFORE, &[b"old"])]);
}

/// Who saved each version.
fn names(store: &mut FlashStore<Flash>) -> Vec<String> {
    versions(store).into_iter().map(|(told, _)| told.replace("-\t-\t", "")).collect()
}

#[test]
fn versions_are_those_of_the_trial_until_it_goes_back_and_stay_if_it_is_confirmed() {
    let flash = Flash::new(2, 60);
    for (who, text) in [("one", &b"1"[..]), ("two", b"2")] {
        save_as(&mut open(&flash, BEFORE), (who, None), text).unwrap();
    }
    let mut store = open(&flash, TRIAL);
    let all = |names: &[&str]| if cfg!(feature = "versions") { names.join(" ") } else { String::new() };
    assert_eq!(names(&mut store).join(" "), all(&["two", "one"]));
    for who in ["three", "four"] {
        save_as(&mut store, (who, None), who.as_bytes()).unwrap();
    }
    // The second one of a trial is written over the first, behind the settings that may come back.
    assert_eq!(names(&mut store).join(" "), all(&["four", "two"]));
    let confirmed = flash.copy(61);
    assert_eq!(read(&mut open(&flash, BEFORE)).unwrap(), b"2");
    assert_eq!(names(&mut open(&flash, BEFORE)).join(" "), all(&["two"]));
    save_as(&mut open(&flash, BEFORE), ("five", None), b"5").unwrap();
    assert_eq!(names(&mut open(&flash, BEFORE)).join(" "), all(&["five", "two"]));

    let mut store = open(&confirmed, CONFIRMED);
    assert_eq!(read(&mut store).unwrap(), b"four");
    assert_eq!(names(&mut store).join(" "), all(&["four", "two"]));
}
