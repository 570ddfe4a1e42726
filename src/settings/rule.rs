//! A routing rule: the five columns of the MobGate paper (Source, Slave ID, IP, TAG, Destination), and a policy.

use core::net::IpAddr;

use crate::settings::{ClientRole, IpPrefix, Policy, PortId, TLS};

/// One row of the routing table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Route {
    /// The port that received the request.
    pub source: PortId,
    /// Unit ids on the requester's side.
    pub units: UnitRange,
    /// The client's address; `None` is `*`, which also matches serial clients.
    pub peer: Option<IpPrefix>,
    /// The role that the client's certificate must have; none: whatever it has.
    pub role: ClientRole,
    /// Translation of the unit id.
    pub tag: Tag,
    /// Where the request goes.
    pub destination: Destination,
    /// What is allowed, and with which priority.
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

/// Translation of the unit id; the response gets the requester's id back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tag {
    /// `*`: unchanged.
    Keep,
    /// `+100`: increased.
    Add(u8),
    /// `-100`: decreased.
    Subtract(u8),
    /// `=7`: replaced.
    Set(u8),
}

impl Tag {
    /// The translated id. `None` if a changed id does not address one unit (1 to 247, or 255, the TCP device itself). The settings
    /// reject rules for which that happens for any unit, or a request to one device could reach all.
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

/// The destination of requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Destination {
    /// A port.
    Port(PortId),
    /// The gateway's own unit.
    Local,
    /// Dropped without response.
    Discard,
    /// Answered 0Ah.
    NoPath,
}

impl Route {
    /// Whether the rule matches a request from `source` for `unit` by `peer` (`None` on serial ports) in the right role.
    pub fn matches(&self, source: PortId, unit: u8, peer: Option<IpAddr>) -> bool {
        self.source == source && self.units.contains(unit) && self.is_for(peer)
    }

    /// Whether the rule matches `peer`, `None` on serial ports. A rule with an address does not match clients without one.
    pub(crate) fn is_for(&self, peer: Option<IpAddr>) -> bool {
        self.peer.is_none_or(|prefix| peer.is_some_and(|peer| prefix.contains(peer)))
    }

    /// Whether the rule is for clients whose role is `role`, which is only found out if the rule has one.
    pub(crate) fn is_for_role(&self, role: &dyn Fn() -> ClientRole) -> bool {
        !TLS || self.role.is_none() || self.role == role()
    }
}
