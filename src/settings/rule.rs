//! A routing rule: the five columns of the MobGate paper (Source, Slave ID, IP, TAG, Destination), and a policy.

use core::net::IpAddr;

use crate::settings::{IpPrefix, Policy, PortId};

/// One row of the routing table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Route {
    /// The port that the request came in by.
    pub source: PortId,
    /// Unit ids as the requester writes them.
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

/// Translation of the unit id on the way out; the way back restores the requester's id.
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
    /// Nowhere, without a response.
    Discard,
    /// Nowhere, answered 0Ah.
    NoPath,
}

impl Route {
    /// Whether a request from `source` for `unit` by `peer` (none on serial ports) falls under this rule.
    pub fn matches(&self, source: PortId, unit: u8, peer: Option<IpAddr>) -> bool {
        self.source == source && self.units.contains(unit) && self.is_for(peer)
    }

    /// Whether the rule is for `peer`, none on serial ports: a rule for an address is not for those that have none.
    pub(crate) fn is_for(&self, peer: Option<IpAddr>) -> bool {
        self.peer.is_none_or(|prefix| peer.is_some_and(|peer| prefix.contains(peer)))
    }
}
