//! What a device sends first, by which it is told apart: `"METER-7"`, or in hexadecimal digits `0x7E0107`.

use core::fmt;

use super::words::{Words, Wrong};
use crate::settings::{FIRST_BYTES_MAX, FirstBytes};

const EXPECTED: &str = "what the device sends first: 1 to 32 bytes, \"TEXT\" or as 0x7E01";
const _: () = assert!(FIRST_BYTES_MAX == 32, "the error text names the number");

/// What bytes begin with; a text cannot.
const HEXADECIMAL: &str = "0x";

/// Parses text, in quotes unless it is one word, or bytes.
pub(super) fn read(words: &Words) -> Result<FirstBytes, Wrong> {
    let word = words.take_quoted();
    let bytes = match word.text.strip_prefix(HEXADECIMAL) {
        Some(digits) => hexadecimal(digits),
        None if is_text(word.text.as_bytes()) => FirstBytes::from_slice(word.text.as_bytes()).ok(),
        None => None,
    };
    bytes.filter(|bytes| !bytes.is_empty()).ok_or_else(|| word.expected(EXPECTED))
}

fn hexadecimal(digits: &str) -> Option<FirstBytes> {
    let mut bytes = FirstBytes::new();
    for pair in digits.as_bytes().chunks(2) {
        let &[high, low] = pair else { return None };
        let digit = |byte: u8| char::from(byte).to_digit(16);
        // Two digits are a byte.
        bytes.push((digit(high)? * 16 + digit(low)?) as u8).ok()?;
    }
    Some(bytes)
}

/// Whether the bytes can stand in quotes.
fn is_text(bytes: &[u8]) -> bool {
    bytes.iter().all(|byte| (b' '..=b'~').contains(byte) && *byte != b'"')
}

/// These bytes as [`read`] takes them.
pub(super) struct Printed<'b>(pub(super) &'b [u8]);

impl fmt::Display for Printed<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match core::str::from_utf8(self.0)
            .ok()
            .filter(|text| is_text(self.0) && !text.starts_with(HEXADECIMAL))
        {
            Some(text) => write!(f, "\"{text}\""),
            None => {
                f.write_str(HEXADECIMAL)?;
                self.0.iter().try_for_each(|byte| write!(f, "{byte:02X}"))
            }
        }
    }
}
