//! The rest of an RTU frame that is passed on while it arrives, from where its end is known: a character in, a character out.
//!
//! That is little enough for a board to do it in its receive interrupt, without a task: see
//! [`SerialLine::relay`](crate::hal::SerialLine::relay).

/// What is left to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Relay {
    /// Characters that have not come yet.
    left: u32,
    /// What changes in the first half of the CRC, where the unit has another id on the other line.
    delta: u8,
}

impl Relay {
    /// Nothing is left.
    pub const OVER: Self = Self { left: 0, delta: 0 };

    /// A frame of which `left` characters are to come, its CRC included; the first half of that differs by the bits of `delta`.
    pub const fn new(left: u32, delta: u8) -> Self {
        Self { left, delta }
    }

    /// Takes the next character, and gives what is to be sent at once. The last one is for the tasks: they know by then whether
    /// the frame is good.
    #[inline]
    pub const fn step(&mut self, received: u8) -> Option<u8> {
        self.left = self.left.saturating_sub(1);
        match self.left {
            0 => None,
            1 => Some(received ^ self.delta),
            _ => Some(received),
        }
    }

    /// Whether the whole frame has come.
    #[inline]
    pub const fn is_over(&self) -> bool {
        self.left == 0
    }

    /// Characters of those that `before` had left which have been sent since.
    pub(crate) fn sent_since(&self, before: &Self) -> usize {
        before.left.saturating_sub(self.left.max(1)) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::Relay;

    #[test]
    fn all_but_the_last_character_is_sent_and_the_first_half_of_the_crc_is_changed() {
        let begun = Relay::new(4, 0x0f);
        let mut relay = begun;
        let sent = [1, 2, 0x30, 4].map(|byte| relay.step(byte));
        assert_eq!(sent, [Some(1), Some(2), Some(0x3f), None]);
        assert!(relay.is_over());
        assert_eq!(relay.sent_since(&begun), 3);
    }

    #[test]
    fn a_relay_that_is_over_sends_nothing() {
        let mut relay = Relay::OVER;
        assert_eq!(relay.step(1), None);
        assert_eq!(relay.sent_since(&Relay::OVER), 0);
    }
}
