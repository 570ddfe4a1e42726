//! Sends what one UART receives by another one, in the receive interrupt: one such relay at a time, as there is one timer that
//! tells when no more comes.

use core::cell::Cell;
use core::sync::atomic::{AtomicUsize, Ordering};

use critical_section::{CriticalSection, Mutex};
use mobgate::port::relay::Relay;

/// No UART.
const NONE: usize = usize::MAX;

/// The UART whose characters are being relayed.
static RUNNING: AtomicUsize = AtomicUsize::new(NONE);
/// The UARTs from and to which the relay leads that was begun and not ended.
static FROM: AtomicUsize = AtomicUsize::new(NONE);
static TO: AtomicUsize = AtomicUsize::new(NONE);
static RELAY: Mutex<Cell<Relay>> = Mutex::new(Cell::new(Relay::OVER));

/// What becomes of a character.
pub(crate) enum Step {
    /// It is sent by this UART.
    Sent(usize, u8),
    /// It was the last one.
    Over,
    /// No relay takes what this UART receives.
    None,
}

/// Whether a relay can begin.
pub(crate) fn is_free() -> bool {
    FROM.load(Ordering::Relaxed) == NONE
}

/// Begins a relay. With interrupts masked.
pub(crate) fn begin(section: CriticalSection, relay: Relay, from: usize, to: usize) {
    RELAY.borrow(section).set(relay);
    FROM.store(from, Ordering::Relaxed);
    TO.store(to, Ordering::Relaxed);
    RUNNING.store(if relay.is_over() { NONE } else { from }, Ordering::Relaxed);
}

/// Ends the relay to UART `to`, if there is one, and gives what is left of it.
pub(crate) fn end(to: usize) -> Option<Relay> {
    critical_section::with(|section| {
        if TO.load(Ordering::Relaxed) != to {
            return None;
        }
        [&RUNNING, &FROM, &TO].into_iter().for_each(|place| place.store(NONE, Ordering::Relaxed));
        Some(RELAY.borrow(section).get())
    })
}

/// Takes a character that UART `from` has received.
#[inline]
pub(crate) fn step(section: CriticalSection, from: usize, byte: u8) -> Step {
    if RUNNING.load(Ordering::Relaxed) != from {
        return Step::None;
    }
    let place = RELAY.borrow(section);
    let mut relay = place.get();
    let sent = relay.step(byte);
    place.set(relay);
    match sent {
        Some(byte) => Step::Sent(TO.load(Ordering::Relaxed), byte),
        None => {
            break_off();
            Step::Over
        }
    }
}

/// Nothing has come for too long.
pub(crate) fn break_off() {
    RUNNING.store(NONE, Ordering::Relaxed);
}

/// Whether the characters of UART `from` are being relayed.
pub(crate) fn is_running(from: usize) -> bool {
    RUNNING.load(Ordering::Relaxed) == from
}

/// Whether a relay of the characters of UART `from` was begun and not ended.
pub(crate) fn is_begun(from: usize) -> bool {
    FROM.load(Ordering::Relaxed) == from
}

/// Whether the relay of UART `from` was broken off.
pub(crate) fn is_broken(from: usize) -> bool {
    is_begun(from)
        && !is_running(from)
        && critical_section::with(|section| !RELAY.borrow(section).get().is_over())
}
