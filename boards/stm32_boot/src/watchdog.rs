//! The chip's watchdog, which nothing but a reset stops.

// On the H7, watchdogs are numbered by core.
#[cfg(not(feature = "h7"))]
use embassy_stm32::pac::IWDG;
#[cfg(feature = "h7")]
use embassy_stm32::pac::IWDG1 as IWDG;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};

/// Counts of the 32 kHz oscillator, divided by 128: 10 s. It may run a third fast; the longest operation is an erase of an F7: 4 s at worst.
const RELOAD: u16 = 2_500 - 1;

pub(crate) fn start() {
    IWDG.kr().write(|command| command.set_key(Key::ENABLE));
    IWDG.pr().write(|prescaler| prescaler.set_pr(Pr::DIVIDE_BY128));
    IWDG.rlr().write(|reload| reload.set_rl(RELOAD));
    IWDG.kr().write(|command| command.set_key(Key::START));
}

/// Gives it another 10 s, before an operation that stalls the chip; has no effect while it is not started.
pub fn feed() {
    IWDG.kr().write(|command| command.set_key(Key::RESET));
}
