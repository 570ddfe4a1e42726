//! MQTT 3.1.1 and 5: the packets of a client. Pure.

// Images without it need only the version in their settings.
#[cfg(feature = "mqtt")]
mod receive;
#[cfg(feature = "mqtt")]
mod send;
#[cfg(feature = "mqtt")]
pub(crate) mod sparkplug;

#[cfg(feature = "mqtt")] // As what they test.
#[cfg(test)]
mod tests;

#[cfg(feature = "mqtt")]
pub(crate) use self::receive::{Accepted, Inbox, Malformed, Received};
#[cfg(feature = "mqtt")]
pub(crate) use self::send::{
    Connect, DUP, LongPacket, Message, PING, Packet, Qos, Reply, Text, Will, Writer, acknowledge, connect,
    publish, publish_into, subscribe,
};

/// The version of the protocol.
// Images without publishers name none.
#[cfg_attr(not(feature = "mqtt"), allow(dead_code))]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Version {
    /// 3.1.1 (OASIS standard, 2014).
    V3,
    /// 5.0 (OASIS standard, 2019).
    V5,
}

/// Longest packet that is sent, in bytes: the values of a point of 2000 bits, or of 125 registers with a scale.
#[cfg(feature = "mqtt")]
pub(crate) const PACKET_BYTES_MAX: usize = 4608;
/// Longest packet that is sent once and not kept: all values of all points, with their names (Sparkplug).
#[cfg(feature = "mqtt")]
pub(crate) const LONG_PACKET_BYTES_MAX: usize =
    if cfg!(feature = "small") { PACKET_BYTES_MAX } else { 1 << 16 };
/// Longest packet that is taken, in bytes; a longer one is passed over.
#[cfg(feature = "mqtt")]
pub(crate) const RECEIVED_BYTES_MAX: usize = 1024;
/// Longest response topic and correlation data of a command, in bytes.
#[cfg(feature = "mqtt")]
pub(crate) const RESPONSE_TOPIC_BYTES_MAX: usize = 100;
#[cfg(feature = "mqtt")]
pub(crate) const CORRELATION_BYTES_MAX: usize = 64;

/// Types of packets, in the upper half of the first byte (3.1.1: table 2.1; 5: table 2-1).
#[cfg(feature = "mqtt")]
mod kind {
    pub(super) const CONNECT: u8 = 1;
    pub(super) const CONNACK: u8 = 2;
    pub(super) const PUBLISH: u8 = 3;
    pub(super) const PUBACK: u8 = 4;
    pub(super) const SUBSCRIBE: u8 = 8;
    pub(super) const SUBACK: u8 = 9;
    pub(super) const PINGREQ: u8 = 12;
    pub(super) const PINGRESP: u8 = 13;
    pub(super) const DISCONNECT: u8 = 14;
}

/// Identifiers of properties (5: table 2-4).
#[cfg(feature = "mqtt")]
mod property {
    pub(super) const RESPONSE_TOPIC: u8 = 0x08;
    pub(super) const CORRELATION: u8 = 0x09;
    pub(super) const SESSION_EXPIRY: u8 = 0x11;
    pub(super) const KEEP_ALIVE: u8 = 0x13;
    pub(super) const RECEIVE_MAX: u8 = 0x21;
    pub(super) const QOS_MAX: u8 = 0x24;
    pub(super) const RETAINS: u8 = 0x25;
    pub(super) const PACKET_MAX: u8 = 0x27;
}
