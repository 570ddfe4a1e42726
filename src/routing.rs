//! Routing rules and their matching: the port that a request goes to, and its unit id there.
//!
//! A rule has the five columns of the MobGate paper (Source, Slave ID, IP, TAG, Destination), followed by a policy: the functions
//! and addresses allowed, and a priority. Rules are tried in table order; the first match decides.

mod onward;

pub use self::onward::{Onward, onward};

use core::net::IpAddr;

use crate::modbus::{Exception, pdu};
use crate::settings::{
    AddressRange, ClientRole, Destination, Policy, PortId, PortKind, Priority, Route, Rules, Settings,
    Sharing, Side, Special, TLS,
};

/// Whether `route` is only a return path for responses: it leads to a port that only sends requests, or starts at one that only
/// responds.
///
/// The paper's tables list these return paths. Responses always return to their requester, so such a rule never matches.
pub fn is_implied(settings: &Settings, route: &Route) -> bool {
    let asks = |id: PortId| settings.port(id).is_some_and(|port| port.kind.side() == Side::Server);
    !asks(route.source) || matches!(route.destination, Destination::Port(id) if asks(id))
}

/// The routing table's decision for a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decision {
    /// Forward it to a port.
    Forward {
        /// The destination.
        port: PortId,
        /// The unit id on that port.
        unit: u8,
        /// Priority in the destination's queue.
        priority: Priority,
        /// How it may share transactions and cached responses.
        sharing: Sharing,
        /// The addresses that a combined read may cover.
        addresses: AddressRange,
    },
    /// Pass it to the gateway's own unit.
    Local,
    /// Drop it without response.
    Discard,
    /// Refuse it with an exception of the gateway.
    Refuse(Exception),
    /// Confirm it like an executed write, without doing anything.
    Ignore {
        /// Its destination was a broadcast, which has no response.
        broadcast: bool,
    },
    /// Broadcast it to every line for which [`leads_to`] holds.
    AllLines,
    /// No rule matches, or the unit id has no meaning here: 0Ah to a TCP client, silence on a shared serial line.
    NoRule,
}

/// Who sends a request, as far as rules look at it.
#[derive(Clone, Copy)]
pub struct Client<'c> {
    /// The address; `None` on serial ports.
    pub peer: Option<IpAddr>,
    /// Finds out the role, which only rules with a role need.
    pub role: &'c dyn Fn() -> ClientRole,
}

impl Client<'_> {
    /// A client at `peer` without a role.
    pub const fn at(peer: Option<IpAddr>) -> Self {
        Self { peer, role: &|| ClientRole::NONE }
    }

    /// Whether `route` is for this client.
    fn takes(&self, route: &Route) -> bool {
        route.is_for(self.peer) && route.is_for_role(self.role)
    }
}

/// Whether any rule routes requests from `source` for `unit`, regardless of the decision; on a serial line, whether the unit
/// belongs to the gateway.
pub fn is_routed(settings: &Settings, source: PortId, unit: u8) -> bool {
    let is_routed = |unit| rule(settings, source, unit, Client::at(None)).is_some();
    match meaning(settings, source, unit) {
        Special::Rules => is_routed(unit),
        Special::Replace(unit) => is_routed(unit),
        Special::Local | Special::AllLines => true,
        Special::Off => false,
    }
}

/// The meaning of `unit` at `source`, if it is special.
pub(crate) fn meaning(settings: &Settings, source: PortId, unit: u8) -> Special {
    settings.port(source).map_or(Special::Rules, |port| port.units.of(unit))
}

/// The first rule that matches. Return paths are skipped, as they would hide the rules after them.
fn rule<'s>(settings: &'s Settings, source: PortId, unit: u8, client: Client<'_>) -> Option<&'s Route> {
    settings.routes.get(first(settings, source, unit, client)?)
}

/// The index of that rule.
fn first(settings: &Settings, source: PortId, unit: u8, client: Client<'_>) -> Option<usize> {
    let is_it =
        |route: &Route| is_met(settings, route, source, unit, client) && route.is_for_role(client.role);
    settings.routes.iter().position(is_it)
}

/// Whether the rule matches a client of the right role.
fn is_met(settings: &Settings, route: &Route, source: PortId, unit: u8, client: Client<'_>) -> bool {
    route.matches(source, unit, client.peer) && !is_implied(settings, route)
}

/// The decision for a request that no rule matches: a client is refused whose role is the reason (Modbus/TCP Security: exception 01).
fn unmatched(settings: &Settings, source: PortId, unit: u8, client: Client<'_>) -> Decision {
    if TLS && settings.routes.iter().any(|route| is_met(settings, route, source, unit, client)) {
        return Decision::Refuse(Exception::ILLEGAL_FUNCTION);
    }
    Decision::NoRule
}

/// The index of the rule by which [`decide`] decides; `None` if it takes none.
// Only the web interface and its console command ask for it.
#[cfg(feature = "web")]
pub(crate) fn deciding(settings: &Settings, source: PortId, unit: u8, client: Client<'_>) -> Option<usize> {
    match meaning(settings, source, unit) {
        Special::Rules => first(settings, source, unit, client),
        Special::Replace(unit) => first(settings, source, unit, client),
        Special::Off | Special::Local | Special::AllLines => None,
    }
}

/// The decision of the first rule of `settings` that matches.
pub fn decide(settings: &Settings, source: PortId, unit: u8, client: Client<'_>, request: &[u8]) -> Decision {
    let unit = match meaning(settings, source, unit) {
        Special::Rules => unit,
        Special::Replace(unit) => unit,
        Special::Off => return Decision::NoRule,
        Special::Local => return Decision::Local,
        Special::AllLines if pdu::is_broadcastable(request) => return Decision::AllLines,
        Special::AllLines => return Decision::Refuse(Exception::ILLEGAL_FUNCTION),
    };
    let Some(route) = rule(settings, source, unit, client) else {
        return unmatched(settings, source, unit, client);
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
            // A broadcast gets no response, so this request would be pointless.
            Some(0) if is_line(settings, port) && !pdu::is_broadcastable(request) => {
                Decision::Refuse(Exception::ILLEGAL_FUNCTION)
            }
            Some(unit) if settings.port(port).is_some_and(|port| port.kind.side() == Side::Client) => {
                let Policy { sharing, addresses, .. } = route.policy;
                Decision::Forward { port, unit, priority, sharing, addresses }
            }
            // No such client-side port.
            _ => Decision::Refuse(Exception::GATEWAY_NO_PATH),
        },
    }
}

/// Whether a broadcast from `source` by `client` goes out on the serial line `port`, and with which priority: rules must lead there
/// for some unit, and all of them must allow `request`, since it reaches all units.
pub fn leads_to(
    settings: &Settings,
    source: PortId,
    client: Client<'_>,
    request: &[u8],
    port: PortId,
) -> Option<Priority> {
    let leads = |(n, route): &(usize, &Route)| {
        route.source == source
            && client.takes(route)
            && route.destination == Destination::Port(port)
            && takers(settings, *n, |above| client.takes(above)).is_none()
    };
    let rules = settings.routes.iter().enumerate().filter(leads);
    let mut ranks = rules.map(|(_, route)| route.policy.admit(request).ok());
    let first = ranks.next().flatten().filter(|_| is_line(settings, port))?;
    ranks.all(|rank| rank.is_some()).then_some(first)
}

/// Whether `source` has rules for this client in another role.
pub(crate) fn is_of_wrong_role(settings: &Settings, source: PortId, client: Client<'_>) -> bool {
    let is_for_others = |route: &Route| route.is_for(client.peer) && !route.is_for_role(client.role);
    TLS && settings.routes.iter().any(|route| route.source == source && is_for_others(route))
}

/// The rules above rule `n` that match all its units, for the same peers.
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

/// Whether the rules of `port` are ever consulted for `unit`.
fn is_asked(settings: &Settings, port: PortId, unit: u8) -> bool {
    // A replacement unit is not special itself.
    meaning(settings, port, unit) == Special::Rules
}

/// Whether `port` is a serial line with the gateway as master.
fn is_line(settings: &Settings, port: PortId) -> bool {
    let kind = settings.port(port).map(|port| &port.kind);
    matches!(kind, Some(PortKind::Serial(serial)) if serial.side == Side::Client)
}

#[cfg(test)]
#[cfg(feature = "tls")] // Roles are told by certificates.
mod tests {
    use super::{Client, is_of_wrong_role};
    use crate::language::apply;
    use crate::settings::{ClientRole, PortId, Settings};

    #[test]
    fn a_broadcast_is_denied_where_a_rule_for_its_clients_address_is_for_another_role() {
        let mut settings = Settings::new();
        for line in [
            "certificate gw own /gw.pem key /gw.key",
            "certificate plant clients /plant.pem",
            "port secure tcp server 802 tls broadcast all",
            "port P502 tcp server 502 broadcast all",
            "port bus serial uart1 rtu client",
            "route secure 1-3 10.0.0.0/8 * bus role operator",
        ] {
            apply(&mut settings, line).unwrap();
        }
        let is_wrong = |port, role, last| {
            let role = ClientRole::new(role).unwrap();
            let client = Client { peer: Some([last, 0, 0, 1].into()), role: &|| role };
            is_of_wrong_role(&settings, PortId(port), client)
        };
        assert!(is_wrong(0, "viewer", 10));
        assert!(!is_wrong(0, "operator", 10) && !is_wrong(0, "viewer", 11) && !is_wrong(1, "viewer", 10));
    }
}
