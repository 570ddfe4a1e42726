//! The settings behind the keywords of port lines.

use super::field::Field;
use crate::settings::{Driver, Framing, Side, StreamFraming, UnitPolicy};

/// The setting that a keyword of a port line changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
}

impl Key {
    /// The bit that records that a line has set it.
    pub(crate) const fn bit(self) -> u64 {
        1 << match self {
            Self::Device => 0,
            Self::Framing(_) => 1,
            Self::Side(_) => 2,
            Self::Baud => 3,
            Self::Format => 4,
            Self::CharTimeout => 5,
            Self::Gap => 6,
            Self::Driver(_) => 7,
            Self::DriverBefore => 8,
            Self::DriverAfter => 9,
            Self::Echo(_) => 10,
            Self::AnswerWithin => 11,
            Self::ReplyDelay => 12,
            Self::Timeout => 13,
            Self::Retries => 14,
            Self::Turnaround => 15,
            Self::StartDelay => 16,
            Self::LateWindow => 17,
            Self::DownAfter => 18,
            Self::Listen => 19,
            Self::Clients => 20,
            Self::Idle => 21,
            Self::Pipeline => 22,
            Self::Lifetime => 23,
            Self::Reserve => 24,
            Self::Allow => 25,
            Self::Stream(_) => 26,
            Self::Server => 27,
            Self::Unit => 28,
            Self::InFlight => 29,
            Self::ConnectTimeout => 30,
            Self::ConnectDelay => 31,
            Self::RequestDelay => 32,
            Self::Requests => 33,
            Self::OnLoss => 34,
            Self::Line => 35,
            Self::Broadcast => 36,
            Self::Confirm(_) => 37,
            Self::Unit255 => 38,
            Self::ReservedUnits => 39,
            Self::Proof => 40,
            Self::ProveOutputs(_) => 41,
            Self::Full => 42,
            Self::Interface => 43,
            Self::Sockets => 44,
            Self::Id => 45,
            Self::Emergencies(_) => 46,
            Self::Modules(_) => 47,
        }
    }
}

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
