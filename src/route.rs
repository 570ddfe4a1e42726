//! Routing rules and their matching: which port a request goes to, and under which unit id.
//!
//! A rule has the five columns of the MobGate paper (Source, Slave ID, IP, TAG, Destination) and, behind them, a
//! policy: functions and addresses that pass, and a priority. Rules are tried in table order; the first that matches decides.

use core::net::IpAddr;

use embassy_time::Duration;

use crate::config::{IpPrefix, PortId, PortKind, Rules, Settings, Side, Special, is_implied};
use crate::modbus::Exception;
use crate::modbus::pdu;

mod cut;
mod functions;
mod policy;

pub use cut::{Onward, onward};
pub use functions::Functions;
pub use policy::{AddressRange, Forbidden, Policy};

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
    /// `+100`: the id is so much higher.
    Add(u8),
    /// `-100`: the id is so much lower.
    Subtract(u8),
    /// `=7`: the id becomes this one.
    Set(u8),
}

impl Tag {
    /// The translated id. None where an id that was changed is not that of one unit: 1 to 247, or 255, the TCP device itself.
    /// Settings are refused when that is so for any unit of the rule, or a request to one device would reach all.
    pub fn apply(self, unit: u8) -> Option<u8> {
        let target = match self {
            Self::Keep => return Some(unit),
            Self::Add(by) => unit.checked_add(by)?,
            Self::Subtract(by) => unit.checked_sub(by)?,
            Self::Set(unit) => unit,
        };
        matches!(target, 1..=247 | 255).then_some(target)
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
        self.source == source && self.units.contains(unit) && self.is_for(peer)
    }

    /// Whether the rule is for `peer`, none on serial ports: a rule for an address is not for those that have none.
    fn is_for(&self, peer: Option<IpAddr>) -> bool {
        self.peer.is_none_or(|prefix| peer.is_some_and(|peer| prefix.contains(peer)))
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
    /// The answer of a write that was carried out, though nothing is.
    Ignore {
        /// It would have gone to all units of a line: they do not answer.
        broadcast: bool,
    },
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

/// What the rules of `source` take `unit` for.
pub(crate) fn meaning(settings: &Settings, source: PortId, unit: u8) -> Special {
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
        Err(_) if route.policy.ignores(request) => {
            let to_line = matches!(route.destination, Destination::Port(port) if is_line(settings, port));
            return Decision::Ignore { broadcast: to_line && route.tag.apply(unit) == Some(0) };
        }
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

/// Whether a broadcast from `source` by `peer` goes out on the serial line `port`, and with which rank: when rules lead there
/// for any units, and all of them let `request` pass, since it reaches the units of all.
pub fn leads_to(
    settings: &Settings,
    source: PortId,
    peer: Option<IpAddr>,
    request: &[u8],
    port: PortId,
) -> Option<Priority> {
    let leads = |(n, route): &(usize, &Route)| {
        route.source == source
            && route.is_for(peer)
            && route.destination == Destination::Port(port)
            && takers(settings, *n, |above| above.is_for(peer)).is_none()
    };
    let rules = settings.routes.iter().enumerate().filter(leads);
    let mut ranks = rules.map(|(_, route)| route.policy.admit(request).ok());
    let first = ranks.next().flatten().filter(|_| is_line(settings, port))?;
    ranks.all(|rank| rank.is_some()).then_some(first)
}

/// The rules above rule `n` that take all units which it names, of those that are `for_the_same` peers.
pub(crate) fn takers(settings: &Settings, n: usize, for_the_same: impl Fn(&Route) -> bool) -> Option<Rules> {
    let rule = settings.routes.get(n)?;
    let above = settings.routes.get(..n)?;
    let mut takers = Rules::default();
    let mut unit = rule.units.first;
    loop {
        let takes = |other: &Route| {
            other.source == rule.source
                && other.units.contains(unit)
                && for_the_same(other)
                && !is_implied(settings, other)
        };
        if is_asked(settings, rule.source, unit) {
            let at = above.iter().position(takes)?;
            takers.add(at);
            unit = above.get(at)?.units.last;
        }
        if unit >= rule.units.last {
            return Some(takers);
        }
        unit += 1;
    }
}

/// Whether the rules of `port` are ever asked for `unit`.
fn is_asked(settings: &Settings, port: PortId, unit: u8) -> bool {
    // What a special unit may be replaced by is none itself.
    meaning(settings, port, unit) == Special::Rules
}

/// Whether `port` is a serial line that the gateway asks on.
fn is_line(settings: &Settings, port: PortId) -> bool {
    let kind = settings.port(port).map(|port| &port.kind);
    matches!(kind, Some(PortKind::Serial(serial)) if serial.side == Side::Client)
}
