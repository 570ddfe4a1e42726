//! Characters on a wire, bit by bit: what one station sends and what another one makes of it, at its own speed and format.

use crate::time::{SECOND, Time};

/// Parity of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    None,
    /// An even number of ones.
    Even,
    /// An odd number of ones.
    Odd,
}

/// A speed and a character format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    /// Bits per second.
    pub baud: u64,
    /// Bits of data.
    pub data_bits: u32,
    /// The bit behind them.
    pub parity: Parity,
    /// Stop bits.
    pub stop_bits: u32,
}

/// 19200 8E1, a line's default.
pub const RTU: Format = Format { baud: 19_200, data_bits: 8, parity: Parity::Even, stop_bits: 1 };
/// 115200 8N1, the console's.
pub const CONSOLE: Format = Format { baud: 115_200, data_bits: 8, parity: Parity::None, stop_bits: 1 };

impl Format {
    /// Bits of a character with start and stop.
    pub fn bits(&self) -> u32 {
        1 + self.data_bits + u32::from(self.parity != Parity::None) + self.stop_bits
    }

    /// How long `count` bits take.
    pub(crate) fn time(&self, count: u32) -> Time {
        u64::from(count) * SECOND / self.baud.max(1)
    }

    /// A character as levels, from the start bit on.
    fn levels(&self, data: u8) -> u32 {
        let ones = u32::from(data).count_ones() & 1;
        let parity = match self.parity {
            Parity::None => return u32::from(data) << 1 | ALL_IDLE << (1 + self.data_bits),
            Parity::Even => ones,
            Parity::Odd => ones ^ 1,
        };
        u32::from(data) << 1 | parity << (1 + self.data_bits) | ALL_IDLE << (2 + self.data_bits)
    }
}

const ALL_IDLE: u32 = u32::MAX;

/// A character that a station sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Character {
    /// The sender's format.
    pub format: Format,
    /// Its bits of data.
    pub data: u8,
}

/// A character as a receiver has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Heard {
    pub(crate) data: u8,
    pub(crate) parity_error: bool,
    pub(crate) framing_error: bool,
}

impl Character {
    /// How long it takes.
    pub(crate) fn time(&self) -> Time {
        self.format.time(self.format.bits())
    }

    /// What a receiver with `format` makes of it, which looks at the middle of each of its own bits.
    pub(crate) fn heard_as(&self, format: &Format) -> Heard {
        let levels = self.format.levels(self.data);
        let level = |bit: u32| {
            let middle = (2 * u64::from(bit) + 1) * self.format.baud / (2 * format.baud.max(1));
            levels >> middle.min(31) & 1
        };
        let data = (0..format.data_bits).fold(0, |data, bit| data | (level(1 + bit) as u8) << bit);
        let odd = u32::from(data).count_ones() & 1;
        let behind = 1 + format.data_bits;
        let (parity_error, stop) = match format.parity {
            Parity::None => (false, behind),
            Parity::Even => (level(behind) != odd, behind + 1),
            Parity::Odd => (level(behind) == odd, behind + 1),
        };
        Heard { data, parity_error, framing_error: level(stop) == 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::{CONSOLE, Character, Format, Heard, Parity, RTU};

    #[test]
    fn a_character_of_the_same_format_arrives_as_it_is() {
        for data in 0..=255 {
            for format in [RTU, CONSOLE, Format { parity: Parity::Odd, ..RTU }] {
                let heard = Character { format, data }.heard_as(&format);
                assert_eq!(heard, Heard { data, parity_error: false, framing_error: false });
            }
        }
    }

    #[test]
    fn another_parity_or_speed_is_an_error() {
        let odd = Format { parity: Parity::Odd, ..RTU };
        assert!(Character { format: odd, data: 0x55 }.heard_as(&RTU).parity_error);
        let slow = Format { baud: 9_600, ..RTU };
        assert!(Character { format: slow, data: 0 }.heard_as(&RTU).framing_error);
        // Two stations may differ by 2 %.
        let near = Format { baud: 19_584, ..RTU };
        let heard = Character { format: near, data: 0xa5 }.heard_as(&RTU);
        assert_eq!(heard, Heard { data: 0xa5, parity_error: false, framing_error: false });
    }
}
