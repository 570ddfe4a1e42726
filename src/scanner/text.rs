//! Text in registers, as it is shown and typed.

use core::fmt::{self, Display};

/// Most registers of a text: what a frame can write.
pub(crate) const TEXT_REGISTERS_MAX: u8 = 123;
/// Most characters.
pub(super) const TEXT_BYTES_MAX: usize = 2 * TEXT_REGISTERS_MAX as usize;

/// The characters of a text, with what pads it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Text<'r>(&'r [u8]);

impl<'r> Text<'r> {
    pub(super) fn new(characters: &'r [u8]) -> Self {
        Self(characters)
    }
}

/// Without the NULs and blanks at its end; what is not printable ASCII, quotes and backslashes are `\x41`, with `#` the backslash of
/// that is two, as in JSON.
impl Display for Text<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let backslash = if f.alternate() { "\\\\" } else { "\\" };
        let end = self.0.iter().rposition(|byte| !matches!(byte, 0 | b' ')).map_or(0, |last| last + 1);
        for &byte in self.0.get(..end).unwrap_or_default() {
            match byte {
                b'"' | b'\\' => write!(f, "{backslash}x{byte:02x}")?,
                b' '..=b'~' => write!(f, "{}", char::from(byte))?,
                _ => write!(f, "{backslash}x{byte:02x}")?,
            }
        }
        Ok(())
    }
}

/// The characters of `text`, in which `\x41` is a byte, with NULs up to so many registers; `None` if they are too many.
pub(super) fn padded(text: &str, registers: u8) -> Option<[u8; TEXT_BYTES_MAX]> {
    let mut into = [0; TEXT_BYTES_MAX];
    let mut places = into.iter_mut().take(2 * usize::from(registers));
    let mut left = text.as_bytes();
    while let [first, rest @ ..] = left {
        let (byte, rest) = match left {
            [b'\\', b'x', high, low, rest @ ..] => {
                let [high, low] = [*high, *low].map(|digit| char::from(digit).to_digit(16));
                ((16 * high? + low?) as u8, rest)
            }
            [b'\\', ..] => return None,
            _ => (*first, rest),
        };
        *places.next()? = byte;
        left = rest;
    }
    Some(into)
}
