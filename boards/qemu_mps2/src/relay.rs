//! Forwards one UART's received characters to another one, in the receive interrupt. One relay at a time, because there is only one
//! idle timer.

use core::cell::Cell;
use core::sync::atomic::{AtomicUsize, Ordering};

use critical_section::{CriticalSection, Mutex};
use mobgate::hal::Relay;

/// No UART.
const NONE: usize = usize::MAX;

/// The UART being relayed from.
static RUNNING: AtomicUsize = AtomicUsize::new(NONE);
/// Source and destination of the relay that was begun and not ended.
static FROM: AtomicUsize = AtomicUsize::new(NONE);
static TO: AtomicUsize = AtomicUsize::new(NONE);
/// The UART whose relay was broken off, until it receives another character.
static SILENT: AtomicUsize = AtomicUsize::new(NONE);
static RELAY: Mutex<Cell<Relay>> = Mutex::new(Cell::new(Relay::OVER));

/// The result of a character.
pub(crate) enum Step {
    /// To be sent by this UART.
    Sent(usize, u8),
    /// It was the last one.
    Over,
    /// This UART is not being relayed.
    None,
}

/// Whether a relay can begin.
pub(crate) fn is_free() -> bool {
    FROM.load(Ordering::Relaxed) == NONE
}

/// Begins a relay. Interrupts must be masked.
pub(crate) fn begin(section: CriticalSection, relay: Relay, from: usize, to: usize) {
    RELAY.borrow(section).set(relay);
    FROM.store(from, Ordering::Relaxed);
    TO.store(to, Ordering::Relaxed);
    RUNNING.store(if relay.is_over() { NONE } else { from }, Ordering::Relaxed);
}

/// Ends the relay to UART `to`, if there is one, and returns its final state.
pub(crate) fn end(to: usize) -> Option<Relay> {
    critical_section::with(|section| {
        if TO.load(Ordering::Relaxed) != to {
            return None;
        }
        [&RUNNING, &FROM, &TO, &SILENT].into_iter().for_each(|place| place.store(NONE, Ordering::Relaxed));
        Some(RELAY.borrow(section).get())
    })
}

/// Processes a character received by UART `from`.
#[inline]
pub(crate) fn step(section: CriticalSection, from: usize, byte: u8) -> Step {
    if RUNNING.load(Ordering::Relaxed) != from {
        if SILENT.load(Ordering::Relaxed) == from {
            SILENT.store(NONE, Ordering::Relaxed);
        }
        return Step::None;
    }
    let place = RELAY.borrow(section);
    let mut relay = place.get();
    let sent = relay.step(byte);
    place.set(relay);
    match sent {
        Some(byte) => Step::Sent(TO.load(Ordering::Relaxed), byte),
        None => {
            RUNNING.store(NONE, Ordering::Relaxed);
            Step::Over
        }
    }
}

/// Breaks the running relay off, if any: the pause is too long for a frame.
pub(crate) fn break_off() {
    let from = RUNNING.load(Ordering::Relaxed);
    if from != NONE {
        SILENT.store(from, Ordering::Relaxed);
        RUNNING.store(NONE, Ordering::Relaxed);
    }
}

/// Whether the characters of UART `from` are being relayed.
pub(crate) fn is_running(from: usize) -> bool {
    RUNNING.load(Ordering::Relaxed) == from
}

/// Whether a relay of the characters of UART `from` was begun and not ended.
pub(crate) fn is_begun(from: usize) -> bool {
    FROM.load(Ordering::Relaxed) == from
}

/// Whether the relay of UART `from` was broken off and not ended, without a character since.
pub(crate) fn is_silent(from: usize) -> bool {
    SILENT.load(Ordering::Relaxed) == from
}

// Tested by the emulator's tests, which include this file: the board has no tests.
#[cfg(test)]
mod tests {
    use super::*;

    fn received(from: usize, byte: u8) -> Step {
        critical_section::with(|section| step(section, from, byte))
    }

    #[test]
    fn a_uart_is_silent_from_when_its_relay_breaks_off_until_the_next_character() {
        assert!(is_free());
        critical_section::with(|section| begin(section, Relay::new(4, 0), 1, 2));
        assert!(is_running(1) && is_begun(1) && !is_silent(1));
        assert!(matches!(received(1, 7), Step::Sent(2, 7)));
        break_off();
        // The idle timer keeps running, for the other UARTs.
        break_off();
        assert!(!is_running(1) && is_begun(1) && is_silent(1));
        assert!(matches!(received(3, 7), Step::None));
        assert!(is_silent(1), "another UART has received something");
        assert!(matches!(received(1, 7), Step::None));
        assert!(!is_silent(1), "it is not silent any more");
        assert_eq!(end(2), Some(Relay::new(3, 0)));
        assert!(is_free());

        critical_section::with(|section| begin(section, Relay::new(1, 0), 1, 2));
        assert!(matches!(received(1, 7), Step::Over));
        assert!(!is_silent(1), "it did not break off");
        assert_eq!(end(2), Some(Relay::OVER));
    }
}
