//! ASCII framing: `:`, two hexadecimal digits for each byte of unit, PDU and LRC, carriage return, line feed.
//!
//! Clauses are those of Modbus over Serial Line V1.02. Frames are delimited by characters, so the [`Decoder`] takes one character
//! at a time and needs no clock; its caller calls [`Decoder::clear`] when a character is overdue.

use super::{PDU_BYTES_MAX, PduLength, crc::lrc};

/// Longest frame in characters (clause 2.5.2.1).
pub const FRAME_CHARS_MAX: usize = 513;
/// The character that ends a frame, unless diagnostics sub-function 3 changed it.
pub const LINE_FEED: u8 = b'\n';

/// The character that begins a frame, wherever it appears.
pub const COLON: u8 = b':';

pub(crate) const CARRIAGE_RETURN: u8 = b'\r';
/// Unit, PDU and LRC.
const BYTES_MAX: usize = PDU_BYTES_MAX + 2;

/// Why characters are not a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AsciiError {
    /// A character other than `0` to `9` and `A` to `F` in the frame.
    #[error("character {0:02X}h is not a hexadecimal digit")]
    NotHex(u8),
    /// The carriage return came after half a byte.
    #[error("odd number of hexadecimal digits")]
    Odd,
    /// More bytes than a frame can have.
    #[error("frame longer than {FRAME_CHARS_MAX} characters")]
    Long,
    /// Shorter than unit, function code and LRC; the number of bytes.
    #[error("frame of {0} bytes")]
    Short(usize),
    /// The frame is corrupt.
    #[error("LRC {received:02X}h, computed {computed:02X}h")]
    Lrc {
        /// The LRC received.
        received: u8,
        /// The LRC of its bytes.
        computed: u8,
    },
    /// This character followed the carriage return instead of the line feed.
    #[error("character {0:02X}h instead of the line feed")]
    NoLf(u8),
}

/// Encodes `unit` and `pdu` into `out`, which has room for them, with `end` ([`LINE_FEED`] by default) as the last character, and
/// returns the part used.
pub fn encode<'a>(unit: u8, pdu: &[u8], out: &'a mut [u8], end: u8) -> Result<&'a [u8], PduLength> {
    let pdu = PduLength::check(pdu)?;
    // The LRC is the negative sum, so the unit can be subtracted afterwards.
    let check = lrc(pdu).wrapping_sub(unit);
    let mut length = 0;
    let mut put = |character| {
        if let Some(place) = out.get_mut(length) {
            *place = character;
            length += 1;
        }
    };
    put(COLON);
    for part in [&[unit], pdu, &[check]] {
        part.iter().flat_map(|&byte| digits(byte)).for_each(&mut put);
    }
    put(CARRIAGE_RETURN);
    put(end);
    Ok(out.get(..length).unwrap_or_default())
}

/// The two digits of a byte.
pub(crate) const fn digits(byte: u8) -> [u8; 2] {
    [digit(byte >> 4), digit(byte & 0xF)]
}

/// The digit for a number below 16.
const fn digit(nibble: u8) -> u8 {
    if nibble < 10 { b'0' + nibble } else { b'A' + nibble - 10 }
}

/// The value of a digit; lower case is refused (clause 2.5.2: "0-9, A-F").
const fn nibble(character: u8) -> Option<u8> {
    match character {
        b'0'..=b'9' => Some(character - b'0'),
        b'A'..=b'F' => Some(character - b'A' + 10),
        _ => None,
    }
}

/// Position within a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Waiting for a `:`; anything else is noise.
    Outside,
    /// First digit of a byte.
    High,
    /// Second digit of a byte, with the value of the first.
    Low(u8),
    /// After the carriage return.
    End,
}

/// Decodes frames from a stream of characters.
#[derive(Debug, Clone)]
pub struct Decoder {
    bytes: [u8; BYTES_MAX],
    length: usize,
    state: State,
    end: u8,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new(LINE_FEED)
    }
}

impl Decoder {
    /// A decoder waiting for `:`; frames end with `end` ([`LINE_FEED`] by default).
    pub const fn new(end: u8) -> Self {
        Self { bytes: [0; BYTES_MAX], length: 0, state: State::Outside, end }
    }

    /// Drops an incomplete frame, because its next character is overdue.
    pub const fn clear(&mut self) {
        self.state = State::Outside;
    }

    /// Whether a frame has begun and not ended; only then can a character be overdue.
    pub fn in_frame(&self) -> bool {
        self.state != State::Outside
    }

    /// The bytes of the latest frame, complete or not: unit, PDU, LRC.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }

    /// Consumes the next character. Returns unit and PDU at the end of a frame, or why it is invalid; characters outside of
    /// frames are ignored.
    pub fn push(&mut self, character: u8) -> Option<Result<(u8, &[u8]), AsciiError>> {
        match self.step(character) {
            Ok(false) => None,
            Ok(true) => {
                self.state = State::Outside;
                Some(self.judge())
            }
            Err(error) => {
                self.state = State::Outside;
                Some(Err(error))
            }
        }
    }

    /// Consumes one character; true at the end of a frame.
    fn step(&mut self, character: u8) -> Result<bool, AsciiError> {
        match (self.state, character) {
            (State::End, character) if character == self.end => return Ok(true),
            // Clause 2.5.2.1: a colon empties the buffer, wherever it appears.
            (_, COLON) => {
                self.length = 0;
                self.state = State::High;
            }
            (State::Outside, _) => {}
            (State::High, CARRIAGE_RETURN) => self.state = State::End,
            (State::Low(_), CARRIAGE_RETURN) => return Err(AsciiError::Odd),
            (State::High, _) => {
                self.state = State::Low(nibble(character).ok_or(AsciiError::NotHex(character))?);
            }
            (State::Low(high), _) => {
                let low = nibble(character).ok_or(AsciiError::NotHex(character))?;
                *self.bytes.get_mut(self.length).ok_or(AsciiError::Long)? = high << 4 | low;
                self.length += 1;
                self.state = State::High;
            }
            (State::End, _) => return Err(AsciiError::NoLf(character)),
        }
        Ok(false)
    }

    /// Unit and PDU from the bytes between `:` and carriage return.
    fn judge(&self) -> Result<(u8, &[u8]), AsciiError> {
        let bytes = self.bytes();
        let [unit, pdu @ .., received] = bytes else {
            return Err(AsciiError::Short(bytes.len()));
        };
        if pdu.is_empty() {
            return Err(AsciiError::Short(bytes.len()));
        }
        let computed = lrc(pdu).wrapping_sub(*unit);
        if computed != *received {
            return Err(AsciiError::Lrc { received: *received, computed });
        }
        Ok((*unit, pdu))
    }
}
