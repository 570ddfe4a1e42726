//! The packets that a client sends.

use core::fmt;

use heapless::Vec;

use super::{PACKET_BYTES_MAX, RECEIVED_BYTES_MAX, Version, kind, property};

/// A packet.
pub(crate) type Packet = Vec<u8, PACKET_BYTES_MAX>;

/// Flags of PUBLISH (3.1.1 and 5: 3.3.1): sent again; at least once; retained by the broker.
pub(crate) const DUP: u8 = 0x08;
const QOS_1: u8 = 0x02;
const RETAIN: u8 = 0x01;

/// Seconds for which the broker keeps the session of a client that is gone.
const SESSION_EXPIRY_S: u32 = 24 * 3_600;
/// The broker sends no message that was retained before the subscription (5: 3.8.3.1).
const NOT_RETAINED: u8 = 0x20;
/// The first byte's lower half where it is fixed (3.1.1: table 2.2).
const RESERVED: u8 = 0x02;

/// Asks whether the broker is there (3.12).
pub(crate) const PING: [u8; 2] = [kind::PINGREQ << 4, 0];

/// A text that is written where it is needed.
pub(crate) type Text<'t> = fmt::Arguments<'t>;

/// What a client says first (3.1).
pub(crate) struct Connect<'c> {
    pub(crate) version: Version,
    pub(crate) client: Text<'c>,
    pub(crate) user: &'c str,
    pub(crate) password: &'c str,
    /// Seconds.
    pub(crate) keep_alive: u16,
    /// What the broker publishes, retained, when the connection breaks.
    pub(crate) will: (Text<'c>, &'static str),
}

/// A message to publish, at least once (3.3).
pub(crate) struct Message<'m> {
    pub(crate) version: Version,
    pub(crate) id: u16,
    pub(crate) retained: bool,
    pub(crate) topic: Text<'m>,
    /// For which request it is, in version 5.
    pub(crate) correlation: &'m [u8],
}

/// Where the response to a command goes, if it says so.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Reply {
    pub(crate) topic: heapless::String<{ super::RESPONSE_TOPIC_BYTES_MAX }>,
    pub(crate) correlation: Vec<u8, { super::CORRELATION_BYTES_MAX }>,
}

/// A packet being written. What does not fit is noticed at the end.
struct Writer {
    packet: Packet,
    is_full: bool,
}

impl Writer {
    /// Begins with the first byte, and room for two bytes of the remaining length.
    fn new(first: u8) -> Self {
        let mut writer = Self { packet: Packet::new(), is_full: false };
        writer.bytes(&[first, 0, 0]);
        writer
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.is_full |= self.packet.extend_from_slice(bytes).is_err();
    }

    fn number(&mut self, number: u16) {
        self.bytes(&number.to_be_bytes());
    }

    /// Binary data with its length (5: 1.5.6).
    fn data(&mut self, data: &[u8]) {
        self.number(data.len() as u16);
        self.bytes(data);
    }

    /// A text with its length (1.5.3; 5: 1.5.4).
    fn text(&mut self, text: Text<'_>) {
        let at = self.packet.len();
        self.number(0);
        self.is_full |= fmt::write(self, text).is_err();
        let bytes = self.packet.len().saturating_sub(at + 2) as u16;
        if let Some(length) = self.packet.get_mut(at..at + 2) {
            length.copy_from_slice(&bytes.to_be_bytes());
        }
    }

    /// The packet with its remaining length (2.2.3; 5: 1.5.5, in as few bytes as possible); `None` if it is too long.
    fn finish(mut self) -> Option<Packet> {
        let [low, high] = split(self.packet.len().checked_sub(3)?);
        if let Some(length) = self.packet.get_mut(1..3) {
            length.copy_from_slice(&[low, high]);
        }
        if high == 0 && !self.is_full {
            self.packet.remove(2);
        }
        (!self.is_full).then_some(self.packet)
    }
}

impl fmt::Write for Writer {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.packet.extend_from_slice(text.as_bytes()).map_err(|_| fmt::Error)
    }
}

/// A length below 16384: seven bits a byte, the lower ones first; the second byte is 0 if one is enough.
fn split(length: usize) -> [u8; 2] {
    let [low, high] = [length & 0x7f, length >> 7].map(|bits| bits as u8);
    [if high > 0 { low | 0x80 } else { low }, high]
}

const _: () = assert!(PACKET_BYTES_MAX < 1 << 14, "two bytes of remaining length");

/// CONNECT: the session stays when the connection breaks.
pub(crate) fn connect(connect: &Connect<'_>) -> Option<Packet> {
    let Connect { version, client, user, password, keep_alive, will } = connect;
    let five = *version == Version::V5;
    let mut writer = Writer::new(kind::CONNECT << 4);
    writer.data(b"MQTT");
    let [has_user, has_password] = [user, password].map(|text| u8::from(!text.is_empty()));
    // A will, at least once, retained.
    let flags = has_user << 7 | has_password << 6 | 0x20 | 0x08 | 0x04;
    writer.bytes(&[if five { 5 } else { 4 }, flags]);
    writer.number(*keep_alive);
    if five {
        writer.bytes(&[5 + 5, property::SESSION_EXPIRY]);
        writer.bytes(&SESSION_EXPIRY_S.to_be_bytes());
        writer.bytes(&[property::PACKET_MAX]);
        writer.bytes(&(RECEIVED_BYTES_MAX as u32).to_be_bytes());
    }
    writer.text(*client);
    if five {
        // The will has no properties.
        writer.bytes(&[0]);
    }
    let (topic, gone) = will;
    writer.text(*topic);
    writer.data(gone.as_bytes());
    for text in [user, password].into_iter().filter(|text| !text.is_empty()) {
        writer.data(text.as_bytes());
    }
    writer.finish()
}

/// PUBLISH with the payload that `write` writes.
pub(crate) fn publish(
    message: &Message<'_>,
    write: impl FnOnce(&mut dyn fmt::Write) -> fmt::Result,
) -> Option<Packet> {
    let Message { version, id, retained, topic, correlation } = message;
    let mut writer = Writer::new(kind::PUBLISH << 4 | QOS_1 | if *retained { RETAIN } else { 0 });
    writer.text(*topic);
    writer.number(*id);
    if *version == Version::V5 {
        match correlation.len() {
            0 => writer.bytes(&[0]),
            bytes => {
                writer.bytes(&[(1 + 2 + bytes) as u8, property::CORRELATION]);
                writer.data(correlation);
            }
        }
    }
    writer.is_full |= write(&mut writer).is_err();
    writer.finish()
}

const _: () = assert!(3 + super::CORRELATION_BYTES_MAX < 128, "one byte of property length");

/// SUBSCRIBE, at most once: the broker keeps no message for a client that is gone.
pub(crate) fn subscribe(version: Version, id: u16, filter: Text<'_>) -> Option<Packet> {
    let mut writer = Writer::new(kind::SUBSCRIBE << 4 | RESERVED);
    writer.number(id);
    if version == Version::V5 {
        writer.bytes(&[0]);
    }
    writer.text(filter);
    writer.bytes(&[if version == Version::V5 { NOT_RETAINED } else { 0 }]);
    writer.finish()
}
