//! Characters of a line as words of a PIO.

use mobgate::hal::Flaws;
use mobgate::settings::{LineSettings, Parity};

/// A line's character format.
#[derive(Clone, Copy)]
pub(crate) struct Format {
    data_bits: u8,
    stop_bits: u8,
    parity: Parity,
}

impl Format {
    pub(crate) const fn new(line: &LineSettings) -> Self {
        Self { data_bits: line.data_bits, stop_bits: line.stop_bits, parity: line.parity }
    }

    /// Data and parity bits: 7 to 9.
    pub(crate) fn bits(self) -> u8 {
        self.data_bits + u8::from(self.parity != Parity::None)
    }

    fn data(self, byte: u8) -> u16 {
        u16::from(byte) & !(u16::MAX << self.data_bits)
    }

    fn parity_bit(self, data: u16) -> u16 {
        let odd = data.count_ones() & 1;
        match self.parity {
            Parity::None => 0,
            Parity::Even => odd as u16,
            Parity::Odd => 1 - odd as u16,
        }
    }

    /// The transmitter's word: in four bits the number of bits before the last one, less one; then start, data, parity, stop bits.
    pub(crate) fn encode(self, byte: u8) -> u16 {
        let data = self.data(byte);
        let stop = u16::MAX << self.bits();
        let bits = stop | self.parity_bit(data) << self.data_bits & !stop | data;
        // The start bit is 0.
        let count = u16::from(self.bits() + self.stop_bits - 1);
        bits << 5 | count
    }

    /// The byte of a receiver's word, which has data, parity and a stop bit in its upper bits. Adds what is wrong with it to `flaws`.
    pub(crate) fn decode(self, word: u16, flaws: &mut Flaws) -> u8 {
        let bits = word >> (u16::BITS - 1 - u32::from(self.bits()));
        let data = bits & !(u16::MAX << self.data_bits);
        let has_parity = self.parity != Parity::None;
        if bits >> self.bits() & 1 == 0 {
            flaws.framing = flaws.framing.saturating_add(1);
        } else if has_parity && bits >> self.data_bits & 1 != self.parity_bit(data) {
            flaws.parity = flaws.parity.saturating_add(1);
        }
        data as u8
    }
}
