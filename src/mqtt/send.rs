//! The packets that a client sends.

use core::fmt;

use heapless::Vec;
use heapless::vec::VecView;

use super::{LONG_PACKET_BYTES_MAX, PACKET_BYTES_MAX, RECEIVED_BYTES_MAX, Version, kind, property};

/// A packet.
pub(crate) type Packet = Vec<u8, PACKET_BYTES_MAX>;
/// One that may be longer.
pub(crate) type LongPacket = Vec<u8, LONG_PACKET_BYTES_MAX>;

/// Flags of PUBLISH (3.1.1 and 5: 3.3.1): sent again; at least once; retained by the broker.
pub(crate) const DUP: u8 = 0x08;
const QOS_1: u8 = 0x02;
const RETAIN: u8 = 0x01;

/// Flags of CONNECT (3.1.1 and 5: 3.1.2.3): a session of before is forgotten; a will, at least once, retained.
const CLEAN: u8 = 0x02;
const WILL: u8 = 0x04;
const WILL_QOS_1: u8 = 0x08;
const WILL_RETAIN: u8 = 0x20;

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
    /// Whether the broker forgets the session of before, and this one when the connection ends.
    pub(crate) is_clean: bool,
    pub(crate) will: Will<'c>,
}

/// What the broker publishes, at least once, when the connection breaks.
pub(crate) struct Will<'c> {
    pub(crate) topic: Text<'c>,
    /// Writes the payload.
    pub(crate) write: &'c dyn Fn(&mut Writer<'_>) -> fmt::Result,
    pub(crate) retained: bool,
}

/// How sure delivery is (4.3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Qos {
    /// At most once.
    Once,
    /// At least once: the acknowledgement has this id.
    Acknowledged(u16),
}

/// A message to publish (3.3).
pub(crate) struct Message<'m> {
    pub(crate) version: Version,
    pub(crate) qos: Qos,
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
pub(crate) struct Writer<'p> {
    packet: &'p mut VecView<u8>,
    is_full: bool,
}

impl<'p> Writer<'p> {
    /// Begins with the first byte, and room for the remaining length.
    fn new(packet: &'p mut VecView<u8>, first: u8) -> Self {
        packet.clear();
        let mut writer = Self { packet, is_full: false };
        writer.bytes(&[first]);
        writer.bytes(&[0; LENGTH_BYTES_MAX]);
        writer
    }

    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        self.is_full |= self.packet.extend_from_slice(bytes).is_err();
    }

    /// A text without its length.
    pub(super) fn formatted(&mut self, text: Text<'_>) {
        self.is_full |= fmt::write(self, text).is_err();
    }

    fn number(&mut self, number: u16) {
        self.bytes(&number.to_be_bytes());
    }

    /// Binary data with its length (5: 1.5.6).
    fn data(&mut self, data: &[u8]) {
        self.number(data.len() as u16);
        self.bytes(data);
    }

    /// What `write` writes, with its length.
    fn written(&mut self, write: impl FnOnce(&mut Self) -> fmt::Result) {
        let at = self.packet.len();
        self.number(0);
        self.is_full |= write(self).is_err();
        let bytes = self.packet.len().saturating_sub(at + 2) as u16;
        if let Some(length) = self.packet.get_mut(at..at + 2) {
            length.copy_from_slice(&bytes.to_be_bytes());
        }
    }

    /// A text with its length (1.5.3; 5: 1.5.4).
    fn text(&mut self, text: Text<'_>) {
        self.written(|writer| fmt::write(writer, text));
    }

    /// What `write` writes, behind its length as a [`varint`].
    pub(super) fn measured(&mut self, write: impl FnOnce(&mut Self)) {
        let at = self.packet.len();
        write(self);
        // The length is known now: it comes last, and is moved to the front.
        let length = varint((self.packet.len() - at) as u64);
        self.bytes(&length);
        if let Some(all) = self.packet.get_mut(at..).filter(|all| all.len() >= length.len()) {
            all.rotate_right(length.len());
        }
    }

    /// Has `write` write. Returns whether there was room for that and for `rest` bytes; if not, nothing is written.
    pub(crate) fn attempt(&mut self, rest: usize, write: impl FnOnce(&mut Self)) -> bool {
        let before = (self.packet.len(), self.is_full);
        write(self);
        let fits = !self.is_full && self.packet.capacity() - self.packet.len() >= rest;
        if !fits {
            self.packet.truncate(before.0);
            self.is_full = before.1;
        }
        fits
    }

    /// Puts the remaining length in its place (2.2.3; 5: 1.5.5, in as few bytes as possible). Returns whether all did fit.
    fn finish(self) -> bool {
        let body = 1 + LENGTH_BYTES_MAX;
        if self.is_full || self.packet.len() < body {
            return false;
        }
        let length = varint((self.packet.len() - body) as u64);
        let idle = LENGTH_BYTES_MAX - length.len();
        self.packet.copy_within(body.., body - idle);
        self.packet.truncate(self.packet.len() - idle);
        if let Some(place) = self.packet.get_mut(1..=length.len()) {
            place.copy_from_slice(&length);
        }
        true
    }
}

impl fmt::Write for Writer<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.packet.extend_from_slice(text.as_bytes()).map_err(|_| fmt::Error)
    }
}

/// A number with seven bits a byte, the lower ones first, in as few bytes as possible. So are lengths in MQTT, and numbers in protobuf.
pub(super) fn varint(mut number: u64) -> Vec<u8, 10> {
    let mut bytes = Vec::new();
    loop {
        let (low, rest) = (number as u8 & 0x7f, number >> 7);
        // Ten bytes have room for 64 bits.
        let _ = bytes.push(if rest > 0 { low | 0x80 } else { low });
        if rest == 0 {
            return bytes;
        }
        number = rest;
    }
}

/// Bytes of the remaining length of the longest packet.
const LENGTH_BYTES_MAX: usize = 3;

const _: () =
    assert!(LONG_PACKET_BYTES_MAX < 1 << (7 * LENGTH_BYTES_MAX) && PACKET_BYTES_MAX <= LONG_PACKET_BYTES_MAX);

/// The packet that `write` writes behind the first byte; `None` if it is too long.
fn packet(first: u8, write: impl FnOnce(&mut Writer<'_>)) -> Option<Packet> {
    let mut packet = Packet::new();
    let mut writer = Writer::new(&mut packet, first);
    write(&mut writer);
    writer.finish().then_some(packet)
}

/// CONNECT.
pub(crate) fn connect(connect: &Connect<'_>) -> Option<Packet> {
    let Connect { version, client, user, password, keep_alive, is_clean, will } = connect;
    let five = *version == Version::V5;
    let [has_user, has_password] = [user, password].map(|text| u8::from(!text.is_empty()));
    let flag = |flag: u8, is_set: bool| if is_set { flag } else { 0 };
    let kept = flag(CLEAN, *is_clean) | flag(WILL_RETAIN, will.retained);
    packet(kind::CONNECT << 4, |writer| {
        writer.data(b"MQTT");
        let flags = has_user << 7 | has_password << 6 | WILL | WILL_QOS_1 | kept;
        writer.bytes(&[if five { 5 } else { 4 }, flags]);
        writer.number(*keep_alive);
        if five {
            writer.bytes(&[5 + 5, property::SESSION_EXPIRY]);
            writer.bytes(&if *is_clean { 0 } else { SESSION_EXPIRY_S }.to_be_bytes());
            writer.bytes(&[property::PACKET_MAX]);
            writer.bytes(&(RECEIVED_BYTES_MAX as u32).to_be_bytes());
        }
        writer.text(*client);
        if five {
            // The will has no properties.
            writer.bytes(&[0]);
        }
        writer.text(will.topic);
        writer.written(will.write);
        for text in [user, password].into_iter().filter(|text| !text.is_empty()) {
            writer.data(text.as_bytes());
        }
    })
}

/// PUBLISH with the payload that `write` writes.
pub(crate) fn publish(
    message: &Message<'_>,
    write: impl FnOnce(&mut Writer<'_>) -> fmt::Result,
) -> Option<Packet> {
    let mut packet = Packet::new();
    publish_into(&mut packet, message, write).then_some(packet)
}

/// The same into `packet`. Returns whether it did fit.
pub(crate) fn publish_into(
    packet: &mut VecView<u8>,
    message: &Message<'_>,
    write: impl FnOnce(&mut Writer<'_>) -> fmt::Result,
) -> bool {
    let Message { version, qos, retained, topic, correlation } = message;
    let flags = if *qos == Qos::Once { 0 } else { QOS_1 } | if *retained { RETAIN } else { 0 };
    let mut writer = Writer::new(packet, kind::PUBLISH << 4 | flags);
    writer.text(*topic);
    if let Qos::Acknowledged(id) = qos {
        writer.number(*id);
    }
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

/// SUBSCRIBE: messages come at most once, since the broker is to keep none for a client that is gone, or at least once.
pub(crate) fn subscribe(version: Version, id: u16, filter: Text<'_>, at_least_once: bool) -> Option<Packet> {
    packet(kind::SUBSCRIBE << 4 | RESERVED, |writer| {
        writer.number(id);
        if version == Version::V5 {
            writer.bytes(&[0]);
        }
        writer.text(filter);
        let options = if version == Version::V5 { NOT_RETAINED } else { 0 };
        writer.bytes(&[options | u8::from(at_least_once)]);
    })
}

/// PUBACK (3.4).
pub(crate) fn acknowledge(id: u16) -> [u8; 4] {
    let [high, low] = id.to_be_bytes();
    [kind::PUBACK << 4, 2, high, low]
}
