//! Diagnosis history (10F3h, ETG.1020): the last messages of a device, which a MainDevice reads and acknowledges, or receives as
//! emergencies.
//!
//! A message refers to a text of the ESI file by its number, and carries the parameters of that text. It is stored with the time
//! since power-on. If all slots hold unacknowledged messages, the oldest one is overwritten; in acknowledge mode, the new one is
//! discarded.

mod message;

use embassy_time::Instant;

use crate::coe::abort::Abort;
use crate::coe::emergency::Emergency;
use message::Message;

pub use message::{MESSAGE_BYTES, PARAMETERS_MAX, Severity, Text};

/// Size of the history.
pub const MESSAGES: usize = 20;
/// The sub-index of the first message.
pub const FIRST_MESSAGE: u8 = 6;

/// Error register: bit 0 generic, bit 4 communication.
const ERROR_REGISTER: u8 = 0x11;

/// Bits of 10F3h:05.
mod flags {
    pub(super) const EMERGENCIES: u16 = 1 << 0;
    /// One bit for each severity.
    pub(super) const DISABLED: u16 = 1 << 1;
    pub(super) const ACKNOWLEDGE: u16 = 1 << 4;
    /// Read only.
    pub(super) const LOST: u16 = 1 << 5;
    pub(super) const WRITABLE: u16 = 0x1f;
}

/// The history. All zeros at start, which keeps a static in `.bss`.
#[derive(Debug)]
pub struct History {
    messages: [Message; MESSAGES],
    /// The slot of the newest message, from 1; 0 if there is none.
    newest: u8,
    /// Number of messages: the newest one and those before it.
    count: u8,
    /// Number of unacknowledged messages.
    unacknowledged: u8,
    /// Number of messages not yet sent as emergencies.
    unsent: u8,
    /// The newest one was not read.
    unread: bool,
    flags: u16,
}

impl History {
    /// An empty history.
    pub const fn new() -> Self {
        Self {
            messages: [Message::NONE; MESSAGES],
            newest: 0,
            count: 0,
            unacknowledged: 0,
            unsent: 0,
            unread: false,
            flags: 0,
        }
    }

    /// Stores a message, unless it equals the newest one, or its severity is disabled.
    pub fn report(&mut self, text: &Text, parameters: &[u8]) {
        let mut message = Message::new(text, parameters);
        let known = self.message(self.newest).is_some_and(|newest| newest.says_the_same_as(&message));
        if known || self.flags & (flags::DISABLED << message.severity()) != 0 {
            return;
        }
        if usize::from(self.unacknowledged) == MESSAGES {
            self.flags |= flags::LOST;
            if self.flags & flags::ACKNOWLEDGE != 0 {
                return;
            }
        }
        message.time_us = Instant::now().as_micros();
        self.newest = self.newest % MESSAGES as u8 + 1;
        if let Some(place) = self.messages.get_mut(usize::from(self.newest) - 1) {
            *place = message;
        }
        let one_more = |count: u8| (count + 1).min(MESSAGES as u8);
        self.count = one_more(self.count);
        self.unacknowledged = one_more(self.unacknowledged);
        self.unread = true;
        if self.sends_emergencies() {
            self.unsent = one_more(self.unsent);
        }
    }

    /// Whether messages are also sent as emergencies.
    pub const fn sends_emergencies(&self) -> bool {
        self.flags & flags::EMERGENCIES != 0
    }

    /// Enables or disables emergencies, like a MainDevice's write to bit 0 of 10F3h:05.
    pub fn set_emergencies(&mut self, on: bool) {
        self.flags = self.flags & !flags::EMERGENCIES | if on { flags::EMERGENCIES } else { 0 };
        if !on {
            self.unsent = 0;
        }
    }

    /// The oldest unsent message.
    pub fn emergency(&mut self) -> Option<Emergency> {
        let age = self.unsent.checked_sub(1)?;
        self.unsent = age;
        let message = self.message(self.place(age)?)?;
        let [text_low, text_high] = message.text.to_le_bytes();
        let [first, second, third] = message.parameters;
        let is_error = message.severity() != Severity::Information as u8;
        Some(Emergency {
            code: message.emergency,
            register: if is_error { ERROR_REGISTER } else { 0 },
            data: [text_low, text_high, first, second, third],
        })
    }

    /// Reads the entry `sub` of 10F3h.
    pub fn read(&mut self, sub: u8, into: &mut [u8]) -> Result<(), Abort> {
        into.fill(0);
        let number = match sub {
            1 => MESSAGES as u16,
            2 => self.sub_index(self.newest).into(),
            3 => self.place(self.unacknowledged).map_or(0, |place| self.sub_index(place)).into(),
            4 if self.flags & flags::ACKNOWLEDGE != 0 => u16::from(self.unacknowledged != 0),
            4 => self.unread.into(),
            5 => self.flags,
            _ => {
                let place = sub.checked_sub(FIRST_MESSAGE - 1).ok_or(Abort::NoEntry)?;
                self.messages.get(usize::from(place) - 1).ok_or(Abort::NoEntry)?.write(into);
                self.unread &= place != self.newest;
                return Ok(());
            }
        };
        into.iter_mut().zip(number.to_le_bytes()).for_each(|(place, byte)| *place = byte);
        Ok(())
    }

    /// Whether `value` may be written at the entry `sub`.
    pub fn check(&self, sub: u8, value: u16) -> Result<(), Abort> {
        match (sub, value) {
            (3, 0) => Ok(()),
            (3, 1..6) => Err(Abort::TooSmall),
            (3, _) => self.age(value).map(|_| ()).ok_or(Abort::TooGreat),
            (5, _) if value & !(flags::WRITABLE | flags::LOST) == 0 => Ok(()),
            _ => Err(Abort::Range),
        }
    }

    /// Writes the checked `value` to the entry `sub`.
    pub fn write(&mut self, sub: u8, value: u16) {
        match (sub, value) {
            (3, 0) => self.clear(),
            (3, _) => {
                let Some(age) = self.age(value) else { return };
                self.unacknowledged = self.unacknowledged.min(age);
                self.unread &= age != 0;
                self.flags &= !flags::LOST;
            }
            _ => {
                self.flags = self.flags & flags::LOST | value & flags::WRITABLE;
                self.set_emergencies(self.sends_emergencies());
            }
        }
    }

    /// Clears all messages, or in acknowledge mode the acknowledged ones.
    fn clear(&mut self) {
        let kept = if self.flags & flags::ACKNOWLEDGE != 0 { self.unacknowledged } else { 0 };
        for age in kept..self.count {
            if let Some(place) = self.place(age)
                && let Some(message) = self.messages.get_mut(usize::from(place) - 1)
            {
                *message = Message::NONE;
            }
        }
        (self.count, self.unacknowledged, self.unsent) = (kept, kept, self.unsent.min(kept));
        self.newest = if kept == 0 { 0 } else { self.newest };
        self.unread &= kept != 0;
        self.flags &= !flags::LOST;
    }

    /// The slot of the message with `age` newer ones.
    fn place(&self, age: u8) -> Option<u8> {
        let messages = MESSAGES as u8;
        (age < self.count).then(|| (self.newest + messages - 1 - age) % messages + 1)
    }

    /// The number of messages newer than the one at a sub-index.
    fn age(&self, sub: u16) -> Option<u8> {
        (0..self.count)
            .find(|age| self.place(*age).is_some_and(|place| u16::from(self.sub_index(place)) == sub))
    }

    fn message(&self, place: u8) -> Option<&Message> {
        self.messages.get(usize::from(place).checked_sub(1)?)
    }

    fn sub_index(&self, place: u8) -> u8 {
        if place == 0 { 0 } else { FIRST_MESSAGE - 1 + place }
    }
}

#[cfg(test)]
mod tests {
    use mobgate_clock as _;

    use super::{History, MESSAGE_BYTES, MESSAGES, Severity, Text};
    use crate::coe::abort::Abort;

    const LATE: Text = Text { id: 7, severity: Severity::Error, emergency: 0x8100, text: "%d is late" };
    const BACK: Text = Text { id: 8, severity: Severity::Information, emergency: 0, text: "%d is back" };

    fn number(history: &mut History, sub: u8) -> u16 {
        let mut bytes = [0; 2];
        history.read(sub, &mut bytes).unwrap();
        u16::from_le_bytes(bytes)
    }

    /// Newest, newest acknowledged, whether there is a new one, flags.
    fn state(history: &mut History) -> [u16; 4] {
        [2, 3, 4, 5].map(|sub| number(history, sub))
    }

    fn message(history: &mut History, sub: u8) -> [u8; MESSAGE_BYTES] {
        let mut bytes = [0; MESSAGE_BYTES];
        history.read(sub, &mut bytes).unwrap();
        bytes
    }

    fn filled(count: usize, flags: u16) -> History {
        let mut history = History::new();
        history.write(5, flags);
        (0..count).for_each(|nth| history.report(&LATE, &[nth as u8]));
        history
    }

    #[test]
    fn a_message_has_code_flags_text_time_and_parameters() {
        let mut history = History::new();
        assert_eq!(state(&mut history), [0, 0, 0, 0]);
        history.report(&LATE, &[3, 200]);
        let bytes = message(&mut history, 6);
        assert_eq!(bytes[..8], [0x00, 0xe0, 7, 0, 0x12, 2, 7, 0]);
        assert_eq!(bytes[16..22], [5, 0, 3, 5, 0, 200]);
        assert_eq!(message(&mut history, 7), [0; MESSAGE_BYTES]);
        let (mut byte, mut other) = ([0], [0]);
        assert_eq!(
            (history.read(25, &mut byte), history.read(26, &mut other)),
            (Ok(()), Err(Abort::NoEntry))
        );
    }

    #[test]
    fn what_is_said_twice_in_a_row_is_kept_once() {
        let mut history = filled(1, 0);
        history.report(&LATE, &[0]);
        assert_eq!(number(&mut history, 2), 6);
        history.report(&BACK, &[0]);
        history.report(&LATE, &[0]);
        assert_eq!(number(&mut history, 2), 8);
    }

    #[test]
    fn in_the_overwrite_mode_the_latest_20_are_kept_and_the_loss_is_told() {
        let mut history = filled(MESSAGES, 0);
        assert_eq!(state(&mut history), [25, 0, 1, 0]);
        message(&mut history, 24);
        assert_eq!(number(&mut history, 4), 1, "an older one was read");
        message(&mut history, 25);
        assert_eq!(number(&mut history, 4), 0);
        history.report(&LATE, &[99]);
        assert_eq!(state(&mut history), [6, 0, 1, 0x20]);
        assert_eq!(message(&mut history, 6)[18], 99);
        history.write(3, 25);
        assert_eq!(state(&mut history), [6, 25, 0, 0], "all but the newest one, which was read");
        history.write(3, 0);
        assert_eq!(state(&mut history), [0, 0, 0, 0]);
        assert_eq!(message(&mut history, 25), [0; MESSAGE_BYTES]);
        history.report(&LATE, &[1]);
        assert_eq!(number(&mut history, 2), 6);
    }

    #[test]
    fn in_the_acknowledge_mode_nothing_is_overwritten_before_it_was_acknowledged() {
        let mut history = filled(MESSAGES + 3, 0x10);
        assert_eq!(state(&mut history), [25, 0, 1, 0x30]);
        assert_eq!(message(&mut history, 6)[18], 0);
        history.write(3, 7);
        assert_eq!(state(&mut history), [25, 7, 1, 0x10]);
        history.report(&BACK, &[1]);
        assert_eq!(state(&mut history), [6, 7, 1, 0x10]);
        history.write(3, 0);
        assert_eq!(message(&mut history, 7), [0; MESSAGE_BYTES], "what was acknowledged is gone");
        assert_eq!(message(&mut history, 8)[18], 2, "and nothing else");
        history.write(3, 6);
        assert_eq!(state(&mut history), [6, 6, 0, 0x10]);
    }

    #[test]
    fn only_messages_that_are_there_can_be_acknowledged() {
        let history = filled(2, 0);
        for (value, expected) in [
            (0, Ok(())),
            (1, Err(Abort::TooSmall)),
            (5, Err(Abort::TooSmall)),
            (6, Ok(())),
            (7, Ok(())),
            (8, Err(Abort::TooGreat)),
            (0x106, Err(Abort::TooGreat)),
        ] {
            assert_eq!(history.check(3, value), expected, "{value}");
        }
        assert_eq!((history.check(5, 0x3f), history.check(5, 0x40)), (Ok(()), Err(Abort::Range)));
        assert_eq!(history.check(2, 0), Err(Abort::Range));
    }

    #[test]
    fn severities_can_be_disabled() {
        for (flags, expected) in [(0, [6, 7]), (0x02, [0, 6]), (0x08, [6, 6]), (0x0e, [0, 0])] {
            let mut history = History::new();
            history.write(5, flags);
            let newest = [&BACK, &LATE].map(|text| {
                history.report(text, &[1]);
                number(&mut history, 2)
            });
            assert_eq!(newest, expected, "{flags:x}");
        }
    }

    #[test]
    fn emergencies_are_sent_once_each_in_their_order_when_that_is_wanted() {
        let mut history = filled(2, 0);
        assert_eq!(history.emergency(), None);
        history.write(5, 1);
        history.report(&LATE, &[7, 8]);
        history.report(&BACK, &[7]);
        let emergency = history.emergency().unwrap();
        assert_eq!((emergency.code, emergency.register, emergency.data), (0x8100, 0x11, [7, 0, 7, 8, 0]));
        let emergency = history.emergency().unwrap();
        assert_eq!((emergency.code, emergency.register, emergency.data), (0, 0, [8, 0, 7, 0, 0]));
        assert_eq!(history.emergency(), None);
        history.report(&LATE, &[9]);
        history.write(5, 0);
        assert_eq!(history.emergency(), None);
    }
}
