//! Routing rules and their matching: which port a request goes to, and under which unit id.
//!
//! A rule has the five columns of the MobGate paper (Source, Slave ID, IP, TAG, Destination) and, behind them, a
//! policy: functions and addresses that pass, and a priority. Rules are tried in table order; the first that matches decides.

use core::net::IpAddr;

use embassy_time::Duration;

use crate::config::{IpPrefix, PortId, PortKind, Settings, Side, Special, is_implied};
use crate::modbus::Exception;
use crate::modbus::pdu::{self, Extent};

mod cut;

pub use cut::{Onward, onward};

/// One row of the routing table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Route {
    /// The port that the request came in by.
    pub source: PortId,
    /// Unit ids as the asker writes them.
    pub units: UnitRange,
    /// The TCP peer; `None` is `*`, which also matches serial sources.
    pub peer: Option<IpPrefix>,
    /// How the unit id is translated.
    pub tag: Tag,
    /// Where the request goes.
    pub destination: Destination,
    /// What may pass, and how urgent it is.
    pub policy: Policy,
}

/// What a rule lets through, and with which rank.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// Which functions pass; others are answered 01h.
    pub functions: Functions,
    /// Data addresses that may be touched; a request for others is answered 02h.
    pub addresses: AddressRange,
    /// Data addresses that may be written; a write to others is answered 02h.
    pub writes: AddressRange,
    /// Rank in the destination's queue.
    pub priority: Priority,
    /// Functions that rank high whatever `priority` says.
    pub urgent: Functions,
    /// Whose answers will do for a read.
    pub sharing: Sharing,
    /// Whether frames from one serial line to another are passed on while they arrive.
    pub cut: Cut,
}

/// Whose answers will do for a read besides one that is sent for it alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sharing {
    /// That of a read which was waiting, too, when it was sent.
    pub merge: Merge,
    /// One that is in memory and not older than this; 0: none. A row of the table must be small: no [`Duration`].
    pub cache_ms: u16,
}

impl Sharing {
    /// Identical reads are merged, since the answer is as new as it would be otherwise; memory is not used.
    pub const DEFAULT: Self = Self { merge: Merge::Identical, cache_ms: 0 };

    /// How old an answer from memory may be.
    pub fn cache(&self) -> Duration {
        Duration::from_millis(self.cache_ms.into())
    }
}

/// Which reads that wait at the same time may be one transaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Merge {
    /// None.
    Off,
    /// Identical ones.
    Identical,
    /// Also those of coils, inputs or registers that overlap, that touch, or that have at most so many unwanted addresses
    /// between them, which are then read along.
    Near(u8),
}

/// Whether frames are passed on while they arrive (cut-through), or when they are whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cut {
    /// Where the board's transmitters cannot underrun.
    #[default]
    Auto,
    /// Wherever it can be done.
    On,
    /// Never.
    Off,
}

impl Default for Policy {
    /// Everything passes, with normal priority.
    fn default() -> Self {
        Self {
            functions: Functions::ALL,
            addresses: AddressRange::ALL,
            writes: AddressRange::ALL,
            priority: Priority::Normal,
            urgent: Functions::NONE,
            sharing: Sharing::DEFAULT,
            cut: Cut::Auto,
        }
    }
}

impl Policy {
    /// The rank of `request`, or the exception that it gets.
    pub fn admit(&self, request: &[u8]) -> Result<Priority, Exception> {
        // A request of which only the unit has come, by a rule that needs no more of it.
        let Some(&function) = request.first() else { return Ok(self.priority) };
        if !self.functions.contains(function) {
            return Err(Exception::ILLEGAL_FUNCTION);
        }
        for extent in pdu::extents(request).into_iter().flatten() {
            if !self.addresses.contains(&extent) || (extent.write && !self.writes.contains(&extent)) {
                return Err(Exception::ILLEGAL_ADDRESS);
            }
        }
        Ok(if self.urgent.contains(function) { Priority::High } else { self.priority })
    }
}

/// Data addresses from `first` to `last` as they are on the wire, both included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AddressRange {
    /// Lowest address.
    pub first: u16,
    /// Highest address, not below `first`.
    pub last: u16,
}

impl AddressRange {
    /// Every address.
    pub const ALL: Self = Self { first: 0, last: u16::MAX };

    /// The addresses in both.
    pub(crate) fn common(&self, other: &Self) -> Self {
        Self { first: self.first.max(other.first), last: self.last.min(other.last) }
    }

    /// Whether all of `extent` is in the range. What runs over the end of the addresses is left to the device to refuse.
    pub fn contains(&self, extent: &Extent) -> bool {
        self.first <= extent.first && extent.last.min(u32::from(u16::MAX)) <= u32::from(self.last)
    }
}

/// Unit ids from `first` to `last`, both included; `*` is 0 to 255.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnitRange {
    /// Lowest id.
    pub first: u8,
    /// Highest id, not below `first`.
    pub last: u8,
}

impl UnitRange {
    /// Every id.
    pub const ALL: Self = Self { first: 0, last: 255 };

    /// Whether `unit` is in the range.
    pub const fn contains(&self, unit: u8) -> bool {
        self.first <= unit && unit <= self.last
    }
}

/// Translation of the unit id on the way out; the way back restores the asker's id.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tag {
    /// `*`: the id stays.
    Keep,
    /// `+100`, `-100`: the id is shifted. Settings are refused when the shift leaves 0 to 255 for any unit of the rule.
    Shift(i16),
    /// `=7`: the id becomes this one.
    Set(u8),
}

impl Tag {
    /// The translated id, or `None` when a shift leaves 0 to 255.
    pub fn apply(self, unit: u8) -> Option<u8> {
        match self {
            Self::Keep => Some(unit),
            Self::Shift(by) => u8::try_from(i16::from(unit) + by).ok(),
            Self::Set(unit) => Some(unit),
        }
    }
}

/// Where a rule sends requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Destination {
    /// To a port.
    Port(PortId),
    /// To the gateway's own unit.
    Local,
    /// Nowhere, without an answer.
    Discard,
    /// Nowhere, answered 0Ah.
    NoPath,
}

/// Which function codes a rule lets through: a set over 1 to 127.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Functions([u16; 8]);

impl Functions {
    /// Every code.
    pub const ALL: Self = Self([!1, !0, !0, !0, !0, !0, !0, !0]);
    /// No code; add some with [`Functions::with`].
    pub const NONE: Self = Self([0; 8]);
    /// Codes that change nothing in the device. Not 43: besides the identification it carries CANopen requests, writes
    /// among them; nor 8, which can restart a device.
    pub const READ_ONLY: Self = Self::NONE
        .with(1)
        .with(2)
        .with(3)
        .with(4)
        .with(7)
        .with(11)
        .with(12)
        .with(17)
        .with(20)
        .with(24)
        .with(43);

    /// The set and `function` besides.
    #[must_use]
    pub const fn with(self, function: u8) -> Self {
        let mut words = self.0;
        words[word(function)] |= 1 << (function % 16);
        Self(words)
    }

    /// Whether `function` is in the set.
    pub const fn contains(&self, function: u8) -> bool {
        self.0[word(function)] >> (function % 16) & 1 == 1
    }
}

/// The word of a [`Functions`] that has the bit of `function`; an exception has its function's.
const fn word(function: u8) -> usize {
    (function & 0x7f) as usize / 16
}

/// Rank in a destination's queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Priority {
    /// Before all others.
    High,
    /// The default.
    #[default]
    Normal,
    /// When nothing else waits, and in any case after a bounded number of others.
    Low,
}

impl Route {
    /// Whether a request from `source` for `unit` by `peer` (none on serial ports) falls under this rule.
    pub fn matches(&self, source: PortId, unit: u8, peer: Option<IpAddr>) -> bool {
        self.source == source
            && self.units.contains(unit)
            && self.peer.is_none_or(|prefix| peer.is_some_and(|peer| prefix.contains(peer)))
    }
}

/// What the routing table says of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decision {
    /// To the port, for the unit as it is called there.
    Forward {
        /// The destination.
        port: PortId,
        /// The translated unit id.
        unit: u8,
        /// Rank in the destination's queue.
        priority: Priority,
        /// Whose answers will do for it.
        sharing: Sharing,
        /// What may be read along with it.
        addresses: AddressRange,
    },
    /// To the gateway's own unit.
    Local,
    /// No answer.
    Discard,
    /// An exception of the gateway.
    Refuse(Exception),
    /// A broadcast to every line that [`leads_to`] says.
    AllLines,
    /// No rule matches, or the unit means nothing here: 0Ah to a TCP client, silence on a shared serial line.
    NoRule,
}

/// Whether a rule leads requests from `source` for `unit` anywhere, whatever comes of them: on a serial line, whether the
/// unit is ours.
pub fn is_routed(settings: &Settings, source: PortId, unit: u8) -> bool {
    match meaning(settings, source, unit) {
        Special::Rules => rule(settings, source, unit, None).is_some(),
        Special::Replace(unit) => rule(settings, source, unit, None).is_some(),
        Special::Local | Special::AllLines => true,
        Special::Off => false,
    }
}

fn meaning(settings: &Settings, source: PortId, unit: u8) -> Special {
    settings.port(source).map_or(Special::Rules, |port| port.units.of(unit))
}

/// The first rule that matches. A way back never does: it would swallow what a rule behind it is for.
fn rule(settings: &Settings, source: PortId, unit: u8, peer: Option<IpAddr>) -> Option<&Route> {
    let mut matching = settings.routes.iter().filter(|route| route.matches(source, unit, peer));
    matching.find(|route| !is_implied(settings, route))
}

/// The decision of the first rule of `settings` that matches.
pub fn decide(
    settings: &Settings,
    source: PortId,
    unit: u8,
    peer: Option<IpAddr>,
    request: &[u8],
) -> Decision {
    let unit = match meaning(settings, source, unit) {
        Special::Rules => unit,
        Special::Replace(unit) => unit,
        Special::Off => return Decision::NoRule,
        Special::Local => return Decision::Local,
        Special::AllLines if pdu::is_broadcastable(request) => return Decision::AllLines,
        Special::AllLines => return Decision::Refuse(Exception::ILLEGAL_FUNCTION),
    };
    let Some(route) = rule(settings, source, unit, peer) else {
        return Decision::NoRule;
    };
    let priority = match route.policy.admit(request) {
        Ok(priority) => priority,
        Err(exception) => return Decision::Refuse(exception),
    };
    match route.destination {
        Destination::Local => Decision::Local,
        Destination::Discard => Decision::Discard,
        Destination::NoPath => Decision::Refuse(Exception::GATEWAY_NO_PATH),
        Destination::Port(port) => match route.tag.apply(unit) {
            // Nobody would answer, and nothing would have been done.
            Some(0) if is_line(settings, port) && !pdu::is_broadcastable(request) => {
                Decision::Refuse(Exception::ILLEGAL_FUNCTION)
            }
            Some(unit) if settings.port(port).is_some_and(|port| port.kind.side() == Side::Client) => {
                let Policy { sharing, addresses, .. } = route.policy;
                Decision::Forward { port, unit, priority, sharing, addresses }
            }
            // There is no such port.
            _ => Decision::Refuse(Exception::GATEWAY_NO_PATH),
        },
    }
}

/// Whether a broadcast from `source` by `peer` goes out on the serial line `port`, and with which rank: when a rule leads
/// there for any unit, and lets `request` pass.
pub fn leads_to(
    settings: &Settings,
    source: PortId,
    peer: Option<IpAddr>,
    request: &[u8],
    port: PortId,
) -> Option<Priority> {
    let by_peer =
        |route: &&Route| route.peer.is_none_or(|prefix| peer.is_some_and(|peer| prefix.contains(peer)));
    let mut rules = settings.routes.iter().filter(|route| route.source == source).filter(by_peer);
    let rule = rules.find(|route| route.destination == Destination::Port(port))?;
    if is_line(settings, port) { rule.policy.admit(request).ok() } else { None }
}

/// Whether `port` is a serial line that the gateway asks on.
fn is_line(settings: &Settings, port: PortId) -> bool {
    let kind = settings.port(port).map(|port| &port.kind);
    matches!(kind, Some(PortKind::Serial(serial)) if serial.side == Side::Client)
}
