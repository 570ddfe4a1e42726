//! The packets that a client receives.

use heapless::{String, Vec};

use super::{RECEIVED_BYTES_MAX, Reply, Version, kind, property};

/// What the broker sent is no packet for a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Malformed;

/// How a broker accepts a client (3.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Accepted {
    /// It has kept the session.
    pub(crate) has_session: bool,
    /// Messages that may be sent without their acknowledgement.
    pub(crate) receive_max: u16,
    /// Whether it takes messages that are sent at least once,
    pub(crate) takes_qos_1: bool,
    /// and retains some.
    pub(crate) retains: bool,
    /// Longest packet that it takes.
    pub(crate) packet_max: u32,
    /// Seconds between packets, if it wants others than the client.
    pub(crate) keep_alive: Option<u16>,
}

impl Accepted {
    const ALL: Self = Self {
        has_session: false,
        receive_max: u16::MAX,
        takes_qos_1: true,
        retains: true,
        packet_max: u32::MAX,
        keep_alive: None,
    };
}

/// A packet.
#[derive(Debug, PartialEq, Eq)]
// One at a time.
#[allow(clippy::large_enum_variant)]
pub(crate) enum Received<'p> {
    /// CONNACK, or the code of a refusal.
    Connected(Result<Accepted, u8>),
    /// PUBLISH.
    Message {
        /// What is to be acknowledged, if the broker sends it at least once.
        id: Option<u16>,
        topic: &'p str,
        payload: &'p [u8],
        /// It was published before the subscription.
        retained: bool,
        /// `None`: where the response should go is too long.
        reply: Option<Reply>,
    },
    /// PUBACK with its reason, from 80h on a refusal.
    Acknowledged { id: u16, reason: u8 },
    /// SUBACK with its reason, likewise.
    Subscribed { reason: u8 },
    /// PINGRESP.
    Pong,
    /// DISCONNECT with its reason.
    Disconnected { reason: u8 },
}

/// Reads fields.
pub(super) struct Cursor<'p>(pub(super) &'p [u8]);

impl<'p> Cursor<'p> {
    pub(super) fn bytes(&mut self, count: usize) -> Result<&'p [u8], Malformed> {
        let (bytes, rest) = self.0.split_at_checked(count).ok_or(Malformed)?;
        self.0 = rest;
        Ok(bytes)
    }

    pub(super) fn byte(&mut self) -> Result<u8, Malformed> {
        self.bytes(1)?.first().copied().ok_or(Malformed)
    }

    fn number(&mut self) -> Result<u16, Malformed> {
        self.bytes(2)?.first_chunk().map(|bytes| u16::from_be_bytes(*bytes)).ok_or(Malformed)
    }

    fn long(&mut self) -> Result<u32, Malformed> {
        self.bytes(4)?.first_chunk().map(|bytes| u32::from_be_bytes(*bytes)).ok_or(Malformed)
    }

    fn data(&mut self) -> Result<&'p [u8], Malformed> {
        let count = self.number()?;
        self.bytes(count.into())
    }

    fn text(&mut self) -> Result<&'p str, Malformed> {
        core::str::from_utf8(self.data()?).map_err(|_| Malformed)
    }

    /// A length of up to four bytes.
    fn length(&mut self) -> Result<usize, Malformed> {
        let (length, bytes) = length(self.0)?.ok_or(Malformed)?;
        self.bytes(bytes)?;
        Ok(length)
    }

    /// The properties, of which there are none in version 3.1.1: calls `each` with what they are and their values.
    fn properties(
        &mut self,
        version: Version,
        each: &mut dyn FnMut(u8, Property<'p>),
    ) -> Result<(), Malformed> {
        if version == Version::V3 || self.0.is_empty() {
            return Ok(());
        }
        let count = self.length()?;
        let mut all = Cursor(self.bytes(count)?);
        while !all.0.is_empty() {
            let id = all.byte()?;
            let value = match id {
                0x01 | 0x17 | 0x19 | 0x24 | 0x25 | 0x28..=0x2a => Property::Number(all.byte()?.into()),
                0x13 | 0x21..=0x23 => Property::Number(all.number()?.into()),
                0x02 | 0x11 | 0x18 | 0x27 => Property::Number(all.long()?),
                0x0b => Property::Number(all.length()? as u32),
                0x03 | 0x08 | 0x09 | 0x12 | 0x15 | 0x16 | 0x1a | 0x1c | 0x1f => Property::Data(all.data()?),
                0x26 => {
                    all.data()?;
                    Property::Data(all.data()?)
                }
                _ => return Err(Malformed),
            };
            each(id, value);
        }
        Ok(())
    }
}

/// The value of a property.
#[derive(Clone, Copy)]
enum Property<'p> {
    Number(u32),
    Data(&'p [u8]),
}

/// The length that `bytes` begin with, and its own number of bytes; `None` while it is incomplete (2.2.3; 5: 1.5.5).
fn length(bytes: &[u8]) -> Result<Option<(usize, usize)>, Malformed> {
    let mut length = 0;
    for (nth, byte) in bytes.iter().take(4).enumerate() {
        length |= usize::from(byte & 0x7f) << (7 * nth);
        if byte & 0x80 == 0 {
            return Ok(Some((length, nth + 1)));
        }
    }
    if bytes.len() < 4 { Ok(None) } else { Err(Malformed) }
}

impl<'p> Received<'p> {
    /// The packet with this first byte and the bytes behind the remaining length.
    fn of(version: Version, first: u8, rest: &'p [u8]) -> Result<Self, Malformed> {
        let mut cursor = Cursor(rest);
        // What version 5 may leave out.
        let reason = |cursor: &mut Cursor<'_>| if cursor.0.is_empty() { Ok(0) } else { cursor.byte() };
        match first >> 4 {
            kind::CONNACK => connected(version, cursor),
            kind::PUBLISH => message(version, first, cursor),
            kind::PUBACK => Ok(Self::Acknowledged { id: cursor.number()?, reason: reason(&mut cursor)? }),
            kind::SUBACK => {
                cursor.number()?;
                cursor.properties(version, &mut |_, _| {})?;
                Ok(Self::Subscribed { reason: cursor.byte()? })
            }
            kind::PINGRESP => Ok(Self::Pong),
            kind::DISCONNECT => Ok(Self::Disconnected { reason: reason(&mut cursor)? }),
            _ => Err(Malformed),
        }
    }
}

fn connected(version: Version, mut cursor: Cursor<'_>) -> Result<Received<'_>, Malformed> {
    let mut accepted = Accepted { has_session: cursor.byte()? & 1 == 1, ..Accepted::ALL };
    let code = cursor.byte()?;
    cursor.properties(version, &mut |id, value| {
        let Property::Number(number) = value else { return };
        match id {
            property::RECEIVE_MAX => accepted.receive_max = number as u16,
            property::QOS_MAX => accepted.takes_qos_1 = number > 0,
            property::RETAINS => accepted.retains = number > 0,
            property::PACKET_MAX => accepted.packet_max = number,
            property::KEEP_ALIVE => accepted.keep_alive = Some(number as u16),
            _ => {}
        }
    })?;
    Ok(Received::Connected(if code == 0 { Ok(accepted) } else { Err(code) }))
}

fn message(version: Version, first: u8, mut cursor: Cursor<'_>) -> Result<Received<'_>, Malformed> {
    let topic = cursor.text()?;
    let id = match first >> 1 & 3 {
        0 => None,
        1 => Some(cursor.number()?),
        // Nothing else was subscribed to.
        _ => return Err(Malformed),
    };
    let mut reply = Some(Reply::default());
    cursor.properties(version, &mut |id, value| {
        let Property::Data(data) = value else { return };
        let text = || core::str::from_utf8(data).ok().and_then(|text| String::try_from(text).ok());
        let is_kept = match (id, &mut reply) {
            (property::RESPONSE_TOPIC, Some(reply)) => text().map(|topic| reply.topic = topic).is_some(),
            (property::CORRELATION, Some(reply)) => {
                Vec::from_slice(data).map(|data| reply.correlation = data).is_ok()
            }
            _ => true,
        };
        if !is_kept {
            reply = None;
        }
    })?;
    Ok(Received::Message { id, topic, payload: cursor.0, retained: first & 1 == 1, reply })
}

/// Cuts what arrives into packets. A packet that is too long is passed over.
pub(crate) struct Inbox {
    bytes: [u8; RECEIVED_BYTES_MAX],
    /// The next packet begins here, and what has arrived ends here.
    begin: usize,
    end: usize,
    /// Bytes of a packet that is too long, which are still to come.
    skipped: usize,
}

impl Inbox {
    pub(crate) const fn new() -> Self {
        Self { bytes: [0; RECEIVED_BYTES_MAX], begin: 0, end: 0, skipped: 0 }
    }

    /// Where what arrives next is put: never empty once [`next`](Self::next) has returned `None`.
    pub(crate) fn room(&mut self) -> &mut [u8] {
        if self.begin > 0 {
            self.bytes.copy_within(self.begin..self.end, 0);
            self.end -= self.begin;
            self.begin = 0;
        }
        self.bytes.get_mut(self.end..).unwrap_or_default()
    }

    /// So many bytes were put there.
    pub(crate) fn arrived(&mut self, count: usize) {
        self.end = (self.end + count).min(RECEIVED_BYTES_MAX);
        let passed = self.skipped.min(self.end - self.begin);
        self.begin += passed;
        self.skipped -= passed;
    }

    /// The next packet, if it is complete.
    pub(crate) fn next(&mut self, version: Version) -> Result<Option<Received<'_>>, Malformed> {
        let Some([first, rest @ ..]) = self.bytes.get(self.begin..self.end) else { return Ok(None) };
        let Some((length, bytes)) = length(rest)? else { return Ok(None) };
        let count = 1 + bytes + length;
        let (begin, have) = (self.begin, self.end - self.begin);
        if count > RECEIVED_BYTES_MAX {
            self.begin = self.end;
            self.skipped = count - have;
            return Ok(None);
        }
        if have < count {
            return Ok(None);
        }
        self.begin += count;
        let rest = self.bytes.get(begin + 1 + bytes..begin + count).unwrap_or_default();
        Received::of(version, *first, rest).map(Some)
    }
}
