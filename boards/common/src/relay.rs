//! Which characters that a line receives its interrupt hands on to another line's transmitter.
//!
//! A board has one [`Relaying`] for each relay that it can run at a time. [`SerialLine::relay`](mobgate::hal::SerialLine::relay)
//! begins it and [`end_relay`](mobgate::hal::SerialLine::end_relay) ends it; in between the receive interrupt asks it about each character.

use core::cell::Cell;
use core::sync::atomic::{AtomicU8, Ordering};

use critical_section::{CriticalSection, Mutex};
use mobgate::hal::Relay;

/// No line. All zeros, so that nothing of a board's statics takes flash.
const NONE: u8 = 0;

/// So many characters before the frame's end its reader is woken, where a board uses [`Relaying::is_withheld`]: until the last one,
/// which a task sends, all before must have gone through the tasks.
const TAIL_CHARS: u32 = 4;

/// A line's number as it is kept: no board has 255.
const fn kept(line: usize) -> u8 {
    line as u8 + 1
}

/// A relay from one line to another. Lines are numbers that the board gives them.
pub struct Relaying {
    /// The line being relayed from.
    running: AtomicU8,
    /// The source of the relay that was begun and not ended, and its destination.
    from: AtomicU8,
    to: AtomicU8,
    /// The line whose relay was broken off, until it receives another character.
    silent: AtomicU8,
    relay: Mutex<Cell<Relay>>,
}

/// The result of a character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// To be sent by this line.
    Sent(usize, u8),
    /// It was the last one.
    Over,
    /// This line is not being relayed.
    None,
}

impl Relaying {
    /// No relay.
    pub const fn new() -> Self {
        Self {
            running: AtomicU8::new(NONE),
            from: AtomicU8::new(NONE),
            to: AtomicU8::new(0),
            silent: AtomicU8::new(NONE),
            relay: Mutex::new(Cell::new(Relay::OVER)),
        }
    }

    /// Whether a relay can begin.
    pub fn is_free(&self) -> bool {
        self.from.load(Ordering::Relaxed) == NONE
    }

    /// The destination of the last relay.
    pub fn to(&self) -> usize {
        self.to.load(Ordering::Relaxed).into()
    }

    /// Begins a relay. Interrupts must be masked.
    pub fn begin(&self, section: CriticalSection, relay: Relay, from: usize, to: usize) {
        self.relay.borrow(section).set(relay);
        self.from.store(kept(from), Ordering::Relaxed);
        self.to.store(to as u8, Ordering::Relaxed);
        self.running.store(if relay.is_over() { NONE } else { kept(from) }, Ordering::Relaxed);
    }

    /// Ends the relay to line `to`, if there is one, and returns its final state.
    pub fn end(&self, to: usize) -> Option<Relay> {
        critical_section::with(|section| {
            if self.is_free() || self.to() != to {
                return None;
            }
            let places = [&self.running, &self.from, &self.silent];
            places.into_iter().for_each(|place| place.store(NONE, Ordering::Relaxed));
            Some(self.relay.borrow(section).get())
        })
    }

    /// Processes a character received by line `from`.
    #[inline]
    pub fn step(&self, section: CriticalSection, from: usize, byte: u8) -> Step {
        if !self.is_running(from) {
            if self.is_silent(from) {
                self.silent.store(NONE, Ordering::Relaxed);
            }
            return Step::None;
        }
        let place = self.relay.borrow(section);
        let mut relay = place.get();
        let sent = relay.step(byte);
        place.set(relay);
        match sent {
            Some(byte) => Step::Sent(self.to(), byte),
            None => {
                self.running.store(NONE, Ordering::Relaxed);
                Step::Over
            }
        }
    }

    /// Breaks the running relay off, if any: the pause is too long for a frame.
    pub fn break_off(&self) {
        let from = self.running.load(Ordering::Relaxed);
        if from != NONE {
            self.silent.store(from, Ordering::Relaxed);
            self.running.store(NONE, Ordering::Relaxed);
        }
    }

    /// Whether the characters of line `from` are being relayed.
    pub fn is_running(&self, from: usize) -> bool {
        self.running.load(Ordering::Relaxed) == kept(from)
    }

    /// Whether what line `from` receives is kept from its reader: it is relayed, and the frame's end is not near.
    pub fn is_withheld(&self, section: CriticalSection, from: usize) -> bool {
        self.is_running(from) && self.relay.borrow(section).get().left() > TAIL_CHARS
    }

    /// Whether a relay of the characters of line `from` was begun and not ended.
    pub fn is_begun(&self, from: usize) -> bool {
        self.from.load(Ordering::Relaxed) == kept(from)
    }

    /// Whether the relay of line `from` was broken off and not ended, without a character since.
    pub fn is_silent(&self, from: usize) -> bool {
        self.silent.load(Ordering::Relaxed) == kept(from)
    }
}

#[cfg(test)]
mod tests {
    use mobgate_clock as _;

    use super::*;

    fn received(relaying: &Relaying, from: usize, byte: u8) -> Step {
        critical_section::with(|section| relaying.step(section, from, byte))
    }

    #[test]
    fn a_line_is_silent_from_when_its_relay_breaks_off_until_the_next_character() {
        let relaying = Relaying::new();
        assert!(relaying.is_free());
        critical_section::with(|section| relaying.begin(section, Relay::new(4, 0), 1, 2));
        assert!(
            !relaying.is_free() && relaying.is_running(1) && relaying.is_begun(1) && !relaying.is_silent(1)
        );
        assert_eq!(received(&relaying, 1, 7), Step::Sent(2, 7));
        relaying.break_off();
        // What detects silence may go on for other lines.
        relaying.break_off();
        assert!(!relaying.is_running(1) && relaying.is_begun(1) && relaying.is_silent(1));
        assert_eq!(received(&relaying, 3, 7), Step::None);
        assert!(relaying.is_silent(1), "another line has received something");
        assert_eq!(received(&relaying, 1, 7), Step::None);
        assert!(!relaying.is_silent(1), "it is not silent any more");
        assert_eq!(relaying.end(1), None, "it goes to another line");
        assert_eq!(relaying.end(2), Some(Relay::new(3, 0)));
        assert!(relaying.is_free());

        critical_section::with(|section| relaying.begin(section, Relay::new(1, 0), 1, 2));
        assert_eq!(received(&relaying, 1, 7), Step::Over);
        assert!(!relaying.is_silent(1), "it did not break off");
        assert_eq!(relaying.end(2), Some(Relay::OVER));
    }
    #[test]
    fn the_reader_has_the_last_characters_one_by_one() {
        let relaying = Relaying::new();
        let is_withheld = |from| critical_section::with(|section| relaying.is_withheld(section, from));
        assert!(!is_withheld(0));
        critical_section::with(|section| relaying.begin(section, Relay::new(6, 0), 0, 1));
        assert!(is_withheld(0) && !is_withheld(1));
        assert_eq!(received(&relaying, 0, 7), Step::Sent(1, 7));
        assert!(is_withheld(0));
        assert_eq!(received(&relaying, 0, 8), Step::Sent(1, 8));
        assert!(!is_withheld(0) && relaying.is_running(0));
    }
}
