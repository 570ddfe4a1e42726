//! The settings behind the keywords of port lines.

use strum::{EnumCount, EnumDiscriminants};

use super::field::Field;
use crate::settings::{Driver, Framing, Side, StreamFraming, UnitPolicy};

/// The setting that a keyword of a port line changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumDiscriminants)]
#[strum_discriminants(name(KeyName), derive(EnumCount))]
pub(crate) enum Key {
    Device,
    Framing(Framing),
    Side(Side),
    Baud,
    Format,
    CharTimeout,
    Gap,
    Driver(Driver),
    DriverBefore,
    DriverAfter,
    Echo(bool),
    AnswerWithin,
    ReplyDelay,
    Timeout,
    Retries,
    Turnaround,
    StartDelay,
    LateWindow,
    DownAfter,
    Proof,
    Listen,
    Clients,
    Idle,
    Pipeline,
    Lifetime,
    Full,
    Reserve,
    Allow,
    Stream(StreamFraming),
    Server,
    Sockets,
    Unit,
    InFlight,
    ConnectTimeout,
    ConnectDelay,
    RequestDelay,
    Requests,
    OnLoss,
    Line,
    Broadcast,
    Confirm(bool),
    Unit255,
    ReservedUnits,
    ProveOutputs(bool),
    Interface,
    Id,
    Emergencies(bool),
    Modules(bool),
    // Images without TLS have no word of it; also below.
    #[cfg(feature = "tls")]
    Tls(bool),
    #[cfg(feature = "tls")]
    Certificate,
    #[cfg(feature = "tls")]
    Trust,
    // Images without a web interface have no word of it.
    #[cfg(feature = "web")]
    Cleartext(bool),
}

impl Key {
    /// The bit that records that a line has set it.
    pub(crate) fn bit(self) -> u64 {
        1 << KeyName::from(self) as u64
    }
}

const _: () = assert!(KeyName::COUNT <= u64::BITS as usize, "there is a bit for each key");

/// Keywords with their keys, in printing order.
pub(crate) type Keys = &'static [(&'static str, Key)];

/// Keywords with their keys, in printing order, and their list for errors.
pub(crate) type Keywords = (Keys, &'static str);

/// The keywords for special unit ids, common to all server-side ports: 0, 255, 248 to 254.
pub(crate) const UNIT_KEYS: Keys = &[
    ("broadcast", Key::Broadcast),
    ("confirm-broadcast", Key::Confirm(true)),
    // For `edit`: resets a flag.
    ("no-confirm-broadcast", Key::Confirm(false)),
    ("unit-255", Key::Unit255),
    ("reserved-units", Key::ReservedUnits),
];

impl UnitPolicy {
    /// The field that `key` sets, if it is one of these.
    pub(crate) fn field(&mut self, key: Key) -> Option<Field<'_>> {
        Some(match key {
            Key::Broadcast => Field::Special(&mut self.broadcast, true),
            Key::Confirm(confirm) => Field::Flag(&mut self.confirm, confirm),
            Key::Unit255 => Field::Special(&mut self.unit_255, false),
            Key::ReservedUnits => Field::Special(&mut self.reserved, false),
            _ => return None,
        })
    }
}
