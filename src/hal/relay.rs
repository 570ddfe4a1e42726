//! A relay: the rest of an RTU frame being cut through, once its length is known. Each received character is sent at once.
//!
//! That is simple enough for a board to do in its receive interrupt, without a task: see
//! [`SerialLine::relay`](crate::hal::SerialLine::relay).

/// The remainder to be relayed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Relay {
    /// Characters still to arrive.
    left: u32,
    /// Bits to change in the first half of the CRC, if the unit id is translated.
    delta: u8,
}

impl Relay {
    /// Nothing left.
    pub const OVER: Self = Self { left: 0, delta: 0 };

    /// A frame with `left` characters to come, including its CRC, whose first half changes by the bits of `delta`.
    pub const fn new(left: u32, delta: u8) -> Self {
        Self { left, delta }
    }

    /// Consumes a received character, and returns the one to send at once. The last character is left to the tasks, which by then
    /// know whether the frame is valid.
    #[inline]
    pub const fn step(&mut self, received: u8) -> Option<u8> {
        self.left = self.left.saturating_sub(1);
        match self.left {
            0 => None,
            1 => Some(received ^ self.delta),
            _ => Some(received),
        }
    }

    /// Characters still to arrive.
    pub const fn left(&self) -> u32 {
        self.left
    }

    /// Whether the whole frame has arrived.
    #[inline]
    pub const fn is_over(&self) -> bool {
        self.left == 0
    }

    /// Number of characters left in `before` that have been sent since.
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
