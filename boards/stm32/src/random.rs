//! Random numbers of the chip's generator (RM0090, 24; RM0410, 20; RM0433, 34), on its clock of 48 MHz.
//!
//! embassy-stm32's driver waits for ever where that clock is missing, and hands out the words that a fault of the noise has spoilt.

use embassy_stm32::pac::RNG;
use embassy_stm32::{peripherals, rcc};

/// Reads until a number is there: it takes 40 cycles of the generator's clock, fewer than these take.
const LOOKS: usize = 10_000;
/// A new seed is tried so often.
const ATTEMPTS: usize = 3;

/// Fills `into` with random numbers; returns whether the generator works.
pub(crate) fn fill(into: &mut [u8]) -> bool {
    rcc::enable_and_reset::<peripherals::RNG>();
    let filled = (0..ATTEMPTS).any(|_| {
        start();
        // The first number is discarded, and each is compared with the one before (FIPS PUB 140-2, as the manuals ask).
        let mut before = number();
        into.chunks_mut(size_of::<u32>()).all(|chunk| {
            let Some(number) = number().filter(|&number| before.is_some_and(|before| before != number))
            else {
                return false;
            };
            before = Some(number);
            chunk.iter_mut().zip(number.to_ne_bytes()).for_each(|(byte, random)| *byte = random);
            true
        })
    });
    rcc::disable::<peripherals::RNG>();
    filled
}

/// Starts the generator with a new seed.
fn start() {
    RNG.cr().write(|control| control.set_rngen(false));
    // Clears what was wrong.
    RNG.sr().write(|status| status.0 = 0);
    RNG.cr().write(|control| control.set_rngen(true));
}

/// A number, if the generator works.
fn number() -> Option<u32> {
    for _ in 0..LOOKS {
        let status = RNG.sr().read();
        if status.ceis() || status.seis() {
            return None;
        }
        if status.drdy() {
            return Some(RNG.dr().read());
        }
    }
    None
}
