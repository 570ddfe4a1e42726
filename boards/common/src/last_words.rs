//! The message of a firmware that died of a fault: kept in memory that survives a reset, read at the next start.

use core::fmt::{self, Write};

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};

// Without a table, as the settings' store.
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);
/// Longest text; longer ones are truncated.
pub const WORDS_BYTES_MAX: usize = 160;

/// Storage for last words. Any memory content is a valid value; after power-up it is random.
#[repr(C)]
#[derive(Debug)]
pub struct LastWords {
    length: u32,
    crc: u32,
    text: [u8; WORDS_BYTES_MAX],
}

impl LastWords {
    /// Empty.
    pub const fn new() -> Self {
        Self { length: 0, crc: 0, text: [0; WORDS_BYTES_MAX] }
    }

    /// Stores `words` for the next start.
    pub fn write(&mut self, words: fmt::Arguments<'_>) {
        self.length = 0;
        // Truncation is not an error.
        let _ = write!(Writer(self), "{words}");
        self.crc = self.sum();
    }

    /// Takes the words of the last run: the second call returns `None`.
    pub fn take(&mut self) -> Option<heapless::String<WORDS_BYTES_MAX>> {
        let kept = self.crc == self.sum() && self.length > 0;
        let words = kept.then(|| core::str::from_utf8(self.kept()).ok()?.try_into().ok()).flatten();
        *self = Self::new();
        words
    }

    fn kept(&self) -> &[u8] {
        self.text.get(..self.length as usize).unwrap_or_default()
    }

    fn sum(&self) -> u32 {
        let mut digest = CRC.digest();
        digest.update(&self.length.to_le_bytes());
        digest.update(self.kept());
        digest.finalize()
    }
}

struct Writer<'a>(&'a mut LastWords);

impl Write for Writer<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for character in text.chars() {
            // Whole characters only, on one line.
            let character = if character.is_control() { ' ' } else { character };
            let at = self.0.length as usize;
            let free = self.0.text.get_mut(at..at + character.len_utf8()).ok_or(fmt::Error)?;
            self.0.length += character.encode_utf8(free).len() as u32;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{LastWords, WORDS_BYTES_MAX};

    #[test]
    fn words_are_read_once_and_are_one_line() {
        let mut words = LastWords::new();
        assert_eq!(words.take(), None);
        words.write(format_args!("panicked at {}:\n{}", "src/main.rs:7", "no"));
        assert_eq!(words.take().as_deref(), Some("panicked at src/main.rs:7: no"));
        assert_eq!(words.take(), None);
    }

    #[test]
    fn long_words_are_cut_off_between_characters() {
        let mut words = LastWords::new();
        words.write(format_args!("{:1$}é", "", WORDS_BYTES_MAX - 1));
        assert_eq!(words.take().map(|words| words.len()), Some(WORDS_BYTES_MAX - 1));
    }

    #[test]
    fn what_memory_holds_after_power_up_is_taken_for_no_words() {
        let mut words = LastWords { length: 0xdead_beef, crc: 0x1234_5678, text: [0x5a; WORDS_BYTES_MAX] };
        assert_eq!(words.take(), None);
        words.write(format_args!("true"));
        words.text[0] ^= 1;
        assert_eq!(words.take(), None);
    }
}
