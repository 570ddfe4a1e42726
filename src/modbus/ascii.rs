//! ASCII framing: `:`, two hexadecimal digits for each byte of unit, PDU and LRC, carriage return, line feed.
//!
//! Clauses are those of Modbus over Serial Line V1.02. Characters bear their own framing here, so the [`Decoder`] takes
//! them one at a time and needs no clock; who feeds it calls [`Decoder::clear`] when a character is overdue.

use super::{PDU_BYTES_MAX, PduLength, crc::lrc};

/// Longest frame in characters (clause 2.5.2.1).
pub const FRAME_CHARS_MAX: usize = 513;
/// The character that ends a frame, unless diagnostics sub-function 3 changed it.
pub const LINE_FEED: u8 = b'\n';

/// The character that begins a frame, wherever it comes.
pub const COLON: u8 = b':';

pub(crate) const CARRIAGE_RETURN: u8 = b'\r';
/// Unit, PDU and LRC.
const BYTES_MAX: usize = PDU_BYTES_MAX + 2;

/// Why characters are no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AsciiError {
    /// A character other than `0` to `9` and `A` to `F` in the frame.
    #[error("character {0:02X}h is no hexadecimal digit")]
    NotHex(u8),
    /// The carriage return came behind half a byte.
    #[error("odd number of hexadecimal digits")]
    Odd,
    /// More bytes than a frame can have.
    #[error("frame longer than {FRAME_CHARS_MAX} characters")]
    Long,
    /// Not even a unit, a function code and an LRC; the fact is the number of bytes.
    #[error("frame of {0} bytes")]
    Short(usize),
    /// The frame was damaged.
    #[error("LRC {received:02X}h, computed {computed:02X}h")]
    Lrc {
        /// What the frame says.
        received: u8,
        /// What its bytes give.
        computed: u8,
    },
    /// This character came behind the carriage return instead of the line feed.
    #[error("character {0:02X}h instead of the line feed")]
    NoLf(u8),
}

/// Writes the frame of `unit` and `pdu` into `out`, ended by `end` ([`LINE_FEED`] by default), and gives the part
/// that it takes.
pub fn encode<'a>(
    unit: u8,
    pdu: &[u8],
    out: &'a mut [u8; FRAME_CHARS_MAX],
    end: u8,
) -> Result<&'a [u8], PduLength> {
    let pdu = PduLength::check(pdu)?;
    // The LRC of the PDU less the unit is the LRC of both.
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

/// The digit of a number below 16.
const fn digit(nibble: u8) -> u8 {
    if nibble < 10 { b'0' + nibble } else { b'A' + nibble - 10 }
}

/// The number of a digit; lower case is refused (clause 2.5.2: "0-9, A-F").
const fn nibble(character: u8) -> Option<u8> {
    match character {
        b'0'..=b'9' => Some(character - b'0'),
        b'A'..=b'F' => Some(character - b'A' + 10),
        _ => None,
    }
}

/// Where the decoder stands in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Waiting for a `:`; anything else is noise.
    Outside,
    /// At the first digit of a byte.
    High,
    /// At the second digit of a byte; this was the first one's number.
    Low(u8),
    /// Behind the carriage return.
    End,
}

/// Finds frames in a stream of characters.
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
    /// A decoder that waits for a `:`; frames end with `end` ([`LINE_FEED`] by default).
    pub const fn new(end: u8) -> Self {
        Self { bytes: [0; BYTES_MAX], length: 0, state: State::Outside, end }
    }

    /// Forgets a frame that has begun, because its next character is overdue.
    pub const fn clear(&mut self) {
        self.state = State::Outside;
    }

    /// Whether a frame has begun and not ended: only then can a character be overdue.
    pub fn in_frame(&self) -> bool {
        self.state != State::Outside
    }

    /// Unit and what else has come of the latest frame, whole or not.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }

    /// Takes the next character. Gives unit and PDU at the end of a frame, or why the frame that had begun is
    /// none; characters outside of frames are skipped in silence.
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

    /// One character further; true at the end of a frame.
    fn step(&mut self, character: u8) -> Result<bool, AsciiError> {
        match (self.state, character) {
            (State::End, character) if character == self.end => return Ok(true),
            // Clause 2.5.2.1: a new colon empties the buffer, wherever it comes.
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

    /// Unit and PDU of the bytes between `:` and carriage return.
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
