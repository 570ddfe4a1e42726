//! A setting of a port by reference: of which sort it is, and its limits.

use core::ops::RangeInclusive;

use embassy_time::Duration;
use heapless::String;

// As what uses it.
#[cfg(feature = "files")]
use crate::settings::FileRights;
#[cfg(feature = "dial-in")]
use crate::settings::FirstBytes;
use crate::settings::{
    Allowed, DEVICE_BYTES_MAX, Driver, Framing, InterfaceName, LineSettings, Name, OnLoss, Prefixes, Proofs,
    ServerAddress, Side, Special, StreamFraming, TcpListen,
};

/// An integer setting: its name in errors, and its limits.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Count(pub(crate) &'static str, pub(crate) RangeInclusive<u32>);

/// One setting of a port.
///
/// The first variants are keywords without a value: each sets the value given here.
#[derive(PartialEq)]
pub(crate) enum Field<'s> {
    Framing(&'s mut Framing, Framing),
    Side(&'s mut Side, Side),
    Driver(&'s mut Driver, Driver),
    Stream(&'s mut StreamFraming, StreamFraming),
    Flag(&'s mut bool, bool),
    Time(&'s mut Duration, &'static RangeInclusive<Duration>),
    /// `None`: as in the specification, or taken from another setting.
    AutoTime(&'s mut Option<Duration>, &'static RangeInclusive<Duration>),
    /// Zero (never) is allowed besides the range.
    Idle(&'s mut Duration, &'static RangeInclusive<Duration>),
    Small(&'s mut u8, &'static Count),
    Medium(&'s mut u16, &'static Count),
    /// `None`: the unit given by the rule.
    Unit(&'s mut Option<u8>, &'static Count),
    /// `None`: the station alias in the EEPROM.
    Id(&'s mut Option<u16>, &'static Count),
    Baud(&'s mut u32, &'static RangeInclusive<u32>),
    Format(&'s mut LineSettings),
    Device(&'s mut String<DEVICE_BYTES_MAX>),
    Listen(&'s mut TcpListen),
    Server(&'s mut Option<ServerAddress>),
    /// Whether newcomers are refused.
    Full(&'s mut bool),
    Reserve(&'s mut u16, &'s mut Prefixes, &'static Count),
    Allow(&'s mut Allowed),
    // As the key.
    #[cfg(feature = "dial-in")]
    First(&'s mut FirstBytes),
    /// The second field: whether [`Special::AllLines`] is allowed.
    Special(&'s mut Special, bool),
    Interface(&'s mut Option<InterfaceName>),
    Line(&'s mut Option<Name>),
    // Left out of images without TLS; also below.
    #[cfg(feature = "tls")]
    Certificate(&'s mut Option<Name>),
    OnLoss(&'s mut OnLoss),
    // Left out of images without files.
    #[cfg(feature = "files")]
    Files(&'s mut FileRights),
    Proofs(&'s mut Proofs),
}
