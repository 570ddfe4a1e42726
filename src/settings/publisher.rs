//! Publishers: MQTT brokers that get the data points.

use embassy_time::Duration;
use heapless::{String, Vec};

use crate::mqtt::Version;
use crate::settings::{Name, ServerAddress, TlsSettings};
// As what uses it; also below.
#[cfg(all(feature = "mqtt", feature = "tls"))]
use crate::settings::{PORTS_MAX, PortId};

/// Whether there are publishers. Without the feature `mqtt` the image has neither the code nor the memory for them.
pub(crate) const MQTT: bool = cfg!(feature = "mqtt");

/// Publishers in the settings.
pub(crate) const PUBLISHERS_MAX: usize = if MQTT { 2 } else { 0 };

/// Longest user name, password and topic prefix in bytes.
const BROKER_USER_BYTES_MAX: usize = 63;
const BROKER_PASSWORD_BYTES_MAX: usize = 127;
const TOPIC_BYTES_MAX: usize = 31;

/// What the topics of a publisher begin with.
pub(crate) type TopicPrefix = String<TOPIC_BYTES_MAX>;

/// How and what is published.
// Images without publishers name none.
#[cfg_attr(not(feature = "mqtt"), allow(dead_code))]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    /// Values, status and alarms, as JSON.
    Json,
    /// The same, and how Home Assistant finds the points by itself (MQTT discovery).
    HomeAssistant,
    /// Sparkplug B 3.0: an edge node whose metrics are the values. The topic prefix is its group, its name that of the publisher.
    Sparkplug,
}

/// A broker, and what it gets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Publisher {
    /// Unique among publishers, without regard to case.
    pub(crate) name: Name,
    pub(crate) broker: ServerAddress,
    pub(crate) version: Version,
    pub(crate) tls: TlsSettings,
    /// Empty: none.
    pub(crate) user: String<BROKER_USER_BYTES_MAX>,
    /// Empty: none. It is shown by `show config secrets` alone.
    pub(crate) password: String<BROKER_PASSWORD_BYTES_MAX>,
    pub(crate) topic: TopicPrefix,
    /// Values that do not change are published this often.
    pub(crate) every: Duration,
    pub(crate) format: Format,
    /// Whether points are written by messages.
    pub(crate) commands: bool,
}

pub(crate) type Publishers = Vec<Publisher, PUBLISHERS_MAX>;

/// The id by which a board asks for the TLS settings of publisher number `nth`: behind those of ports.
#[cfg(all(feature = "mqtt", feature = "tls"))]
pub(crate) fn publisher_id(nth: usize) -> PortId {
    PortId((PORTS_MAX + nth) as u8)
}
