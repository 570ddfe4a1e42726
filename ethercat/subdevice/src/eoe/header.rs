//! The header of a message: two words, of which the second is a fragment's place, or a response's result.

use crate::mailbox::{MailboxError, PAYLOAD_BYTES_MAX, Payload};

/// Bytes of the header.
pub(super) const HEADER_BYTES: usize = 4;
/// Offsets count in these; so do fragments, except the last one.
pub(super) const UNIT_BYTES: usize = 32;

/// Bits of the first word, behind the kind and the port.
const LAST: u16 = 1 << 8;
const TIME_APPENDED: u16 = 1 << 9;
const TIME_REQUESTED: u16 = 1 << 10;

/// Both words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    info: u16,
    place: u16,
}

impl Header {
    /// Splits the header off a message.
    pub(super) fn decode(payload: &[u8]) -> Result<(Self, &[u8]), MailboxError> {
        let (&[a, b, c, d], body) =
            payload.split_first_chunk::<HEADER_BYTES>().ok_or(MailboxError::SizeTooShort)?;
        Ok((Self { info: u16::from_le_bytes([a, b]), place: u16::from_le_bytes([c, d]) }, body))
    }

    /// Of the response to a request of a kind.
    pub(super) fn response(kind: u8, port: u8, result: u16) -> Self {
        let info = u16::from(kind + 1) | u16::from(port) << 4 | LAST;
        Self { info, place: result }
    }

    /// Of a fragment at `offset`, in units.
    pub(super) fn fragment(port: u8, last: bool, number: u8, offset: usize, frame: u8) -> Self {
        let info = u16::from(port) << 4 | if last { LAST } else { 0 };
        // Lossless: a frame has 48 units.
        Self { info, place: u16::from(number) | (offset as u16) << 6 | u16::from(frame) << 12 }
    }

    /// A message with this header. The caller has cut `body` to the mailbox's size.
    pub(super) fn message(self, body: &[u8]) -> Payload {
        let mut payload = Payload::new();
        let header = self.info.to_le_bytes().into_iter().chain(self.place.to_le_bytes());
        payload.extend(header.chain(body.iter().copied()).take(PAYLOAD_BYTES_MAX));
        payload
    }

    pub(super) const fn kind(self) -> u8 {
        (self.info & 0x0f) as u8
    }

    pub(super) const fn port(self) -> u8 {
        (self.info >> 4 & 0x0f) as u8
    }

    pub(super) const fn is_last(self) -> bool {
        self.info & LAST != 0
    }

    /// Whether a time stands behind the frame's last byte.
    pub(super) const fn has_time(self) -> bool {
        self.info & TIME_APPENDED != 0
    }

    /// Whether the sender wants to know when its frame was passed on.
    pub(super) const fn asks_time(self) -> bool {
        self.info & TIME_REQUESTED != 0
    }

    /// The fragment's number in its frame.
    pub(super) const fn number(self) -> u8 {
        (self.place & 0x3f) as u8
    }

    /// Bytes before the fragment; in the first one those of the frame, rounded up.
    pub(super) const fn offset(self) -> usize {
        (self.place >> 6 & 0x3f) as usize * UNIT_BYTES
    }

    /// The frame's number.
    pub(super) const fn frame(self) -> u8 {
        (self.place >> 12) as u8
    }
}
