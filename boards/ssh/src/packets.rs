//! Packets (RFC 4253, 6): incoming ones are cut out of a stream and opened in place, outgoing ones are composed and sealed.

use core::ops::Range;

use embedded_io_async::{Read, Write};

use crate::Error;
use crate::cipher::{Key, LENGTH_BYTES, TAG_BYTES};
use crate::wire::Writer;

/// The longest packet that is taken, with its length and its tag. The longest that clients send before a channel is open, an offer of
/// algorithms, has 1.6 kB with OpenSSH; the channel bounds the others. RFC 4253 asks for 35000 bytes, for which boards have no room.
pub(crate) const INCOMING_BYTES_MAX: usize = 3072;
/// The longest that is sent.
const OUTGOING_BYTES_MAX: usize = 1024;
/// The longest payload that is sent: with the longest padding.
const PAYLOAD_BYTES_MAX: usize = OUTGOING_BYTES_MAX - TAG_BYTES - PADDING_BYTES_MAX;
/// The padding's length stands behind the packet's.
const PADDING_AT: usize = LENGTH_BYTES;
const PAYLOAD_AT: usize = PADDING_AT + 1;
const PADDING_BYTES_MIN: usize = 4;
const PADDING_BYTES_MAX: usize = PADDING_BYTES_MIN + BLOCK_BYTES;
/// What lengths are multiples of.
const BLOCK_BYTES: usize = 8;

/// Received bytes.
pub(crate) struct Incoming {
    bytes: [u8; INCOMING_BYTES_MAX],
    filled: usize,
    /// Bytes at the beginning that have been used.
    used: usize,
    key: Option<Key>,
    sequence: u32,
}

impl Incoming {
    pub(crate) const fn new() -> Self {
        Self { bytes: [0; _], filled: 0, used: 0, key: None, sequence: 0 }
    }

    /// How many packets there were since the numbers began.
    pub(crate) const fn sequence(&self) -> u32 {
        self.sequence
    }

    /// The following packets are encrypted with `key`, and numbered anew if so.
    pub(crate) fn use_key(&mut self, key: Key, anew: bool) {
        self.key = Some(key);
        if anew {
            self.sequence = 0;
        }
    }

    /// Waits for more bytes. Dropping the pending future loses none.
    pub(crate) async fn fill(&mut self, from: &mut impl Read) -> Result<(), Error> {
        self.move_up();
        let space = self.bytes.get_mut(self.filled..).filter(|space| !space.is_empty());
        let count = from.read(space.ok_or(Error::MALFORMED)?).await.map_err(|_| Error::Closed)?;
        self.filled += count;
        if count == 0 { Err(Error::Closed) } else { Ok(()) }
    }

    fn move_up(&mut self) {
        if self.used > 0 {
            self.bytes.copy_within(self.used..self.filled, 0);
            self.filled -= self.used;
            self.used = 0;
        }
    }

    /// The first line without its end, once there is one of at most `longest` bytes.
    pub(crate) fn line(&mut self, longest: usize) -> Result<Option<&[u8]>, Error> {
        let there = self.bytes.get(..self.filled).unwrap_or_default();
        let Some(end) = there.iter().take(longest).position(|byte| *byte == b'\n') else {
            return if self.filled < longest { Ok(None) } else { Err(Error::MALFORMED) };
        };
        self.used = end + 1;
        Ok(there.get(..end).map(|line| line.strip_suffix(b"\r").unwrap_or(line)))
    }

    /// The next packet's payload as a part of [`payload`](Self::payload), if it has arrived.
    pub(crate) fn next(&mut self) -> Result<Option<Range<usize>>, Error> {
        self.move_up();
        let Some(length) = self.bytes.get(..self.filled).and_then(|there| there.first_chunk()) else {
            return Ok(None);
        };
        let (length, tag_bytes) = match &self.key {
            Some(key) => (key.length(self.sequence, *length), TAG_BYTES),
            None => (*length, 0),
        };
        let length = u32::from_be_bytes(length) as usize;
        // An encrypted packet's length is not part of what is padded.
        let padded = if tag_bytes > 0 { length } else { length.saturating_add(LENGTH_BYTES) };
        let fits = length <= INCOMING_BYTES_MAX - LENGTH_BYTES - tag_bytes;
        if !fits || length < BLOCK_BYTES || !padded.is_multiple_of(BLOCK_BYTES) {
            return Err(Error::MALFORMED);
        }
        let end = LENGTH_BYTES + length;
        if self.filled < end + tag_bytes {
            return Ok(None);
        }
        if let Some(key) = &self.key {
            let (packet, behind) = self.bytes.split_at_mut_checked(end).ok_or(Error::MALFORMED)?;
            let tag = behind.first_chunk().ok_or(Error::MALFORMED)?;
            if !key.open(self.sequence, packet, tag) {
                return Err(Error::MALFORMED);
            }
        }
        // No number may be used twice with a key.
        self.sequence = self.sequence.checked_add(1).ok_or(Error::MALFORMED)?;
        self.used = end + tag_bytes;
        let padding = self.bytes.get(PADDING_AT).map_or(0, |padding| usize::from(*padding));
        let payload = PAYLOAD_AT..end.saturating_sub(padding);
        if padding < PADDING_BYTES_MIN || payload.is_empty() {
            Err(Error::MALFORMED)
        } else {
            Ok(Some(payload))
        }
    }

    /// The bytes of the last packet, until more are filled in.
    pub(crate) fn payload(&self, part: Range<usize>) -> &[u8] {
        self.bytes.get(part).unwrap_or_default()
    }
}

/// The packet that is sent.
pub(crate) struct Outgoing {
    bytes: [u8; OUTGOING_BYTES_MAX],
    /// Bytes of the payload.
    length: usize,
    key: Option<Key>,
    sequence: u32,
}

impl Outgoing {
    pub(crate) const fn new() -> Self {
        Self { bytes: [0; _], length: 0, key: None, sequence: 0 }
    }

    /// As [`Incoming::use_key`].
    pub(crate) fn use_key(&mut self, key: Key, anew: bool) {
        self.key = Some(key);
        if anew {
            self.sequence = 0;
        }
    }

    /// Composes a packet's payload, which begins with the message's number.
    pub(crate) fn compose(
        &mut self,
        number: u8,
        write: impl FnOnce(&mut Writer<'_>),
    ) -> Result<&[u8], Error> {
        let space = self.bytes.get_mut(PAYLOAD_AT..).and_then(|space| space.get_mut(..PAYLOAD_BYTES_MAX));
        let mut writer = Writer::new(space.unwrap_or_default());
        writer.byte(number);
        write(&mut writer);
        self.length = writer.finish().ok_or(Error::MALFORMED)?;
        Ok(self.bytes.get(PAYLOAD_AT..PAYLOAD_AT + self.length).unwrap_or_default())
    }

    /// Sends the packet. A pending future must not be dropped, unless the connection ends.
    pub(crate) async fn send(&mut self, to: &mut impl Write) -> Result<(), Error> {
        let padded = 1 + self.length + if self.key.is_some() { 0 } else { LENGTH_BYTES };
        let padding = (padded + PADDING_BYTES_MIN).next_multiple_of(BLOCK_BYTES) - padded;
        let end = PAYLOAD_AT + self.length + padding;
        let (packet, behind) = self.bytes.split_at_mut_checked(end).ok_or(Error::MALFORMED)?;
        if let Some((head, rest)) = packet.split_first_chunk_mut() {
            *head = ((end - LENGTH_BYTES) as u32).to_be_bytes();
            if let Some(first) = rest.first_mut() {
                *first = padding as u8;
            }
            // It need not be random: the cipher's stream is.
            rest.iter_mut().skip(1 + self.length).for_each(|byte| *byte = 0);
        }
        let mut bytes = end;
        if let Some(key) = &self.key {
            let tag = key.seal(self.sequence, packet);
            *behind.first_chunk_mut().ok_or(Error::MALFORMED)? = tag;
            bytes += TAG_BYTES;
        }
        self.sequence = self.sequence.checked_add(1).ok_or(Error::MALFORMED)?;
        let packet = self.bytes.get(..bytes).unwrap_or_default();
        to.write_all(packet).await.map_err(|_| Error::Closed)?;
        to.flush().await.map_err(|_| Error::Closed)
    }
}
