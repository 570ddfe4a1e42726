//! Power cuts at every word written and every sector erased while settings are saved to flash.

use mobgate_flash::{FlashStore, Image};
use mobgate_simulator::flash::SimFlash;
use mobgate_simulator::power_cuts::{Tally, sweep, text};

use crate::prelude::*;

/// Small, so that the sectors fill up and are erased within a few saves.
const SECTOR: usize = 16 * 1024;
/// Lengths of the old and the new text: within one piece, over several, to none and back.
const LENGTHS: [(usize, usize); 4] = [(300, 900), (2_500, 1_100), (1_022, 0), (0, 3_000)];

pub(crate) fn figures() {
    let tallies = LENGTHS.into_iter().enumerate().flat_map(|(nth, lengths)| {
        // The words of an STM32H7, and those of an STM32F7.
        (0..10).map(
            move |saves| if nth % 2 == 0 { cut::<32>(saves, lengths) } else { cut::<16>(saves, lengths) },
        )
    });
    // The words of an STM32F4: eight times the steps.
    let all = tallies.chain([cut::<4>(5, LENGTHS[1])]).fold(Tally::default(), |sum, tally| Tally {
        cuts: sum.cuts + tally.cuts,
        old: sum.old + tally.old,
        new: sum.new + tally.new,
        garbage: sum.garbage + tally.garbage,
        stuck: sum.stuck + tally.stuck,
    });
    figure("power_cuts", all.cuts as f64, "cuts", Target::AtLeast(5_000.0));
    figure("power_cuts_old_settings", all.old as f64, "starts", Target::None);
    figure("power_cuts_new_settings", all.new as f64, "starts", Target::None);
    figure("power_cuts_garbage", all.garbage as f64, "starts", Target::AtMost(0.0));
    figure("power_cuts_stuck", all.stuck as f64, "saves", Target::AtMost(0.0));
}

fn cut<const WORD: usize>(saves: usize, (old, new): (usize, usize)) -> Tally {
    let texts = (text(old, 1), text(new, 2));
    let open = async |flash: SimFlash<WORD, SECTOR>| FlashStore::open(flash, 0, Image::ONLY).await;
    sweep(open, saves, (&texts.0, &texts.1), saves as u64)
}
