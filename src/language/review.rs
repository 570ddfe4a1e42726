//! Finds likely mistakes in valid settings: short gaps, rules that never match or lead to units without a server, requests that
//! return to their rule.

use core::net::{IpAddr, Ipv4Addr};

use super::problem::Warning;
use crate::routing::{is_implied, meaning, takers};
use crate::settings::{
    Destination, Framing, Host, OwnNetwork, Port, PortId, PortKind, Route, Rules, SERVERS, SerialSettings,
    ServerAddress, Settings, Special, StreamFraming, TcpClientSettings, UnitRange,
};

/// Most hops along which a request is followed; bounds loops that shift the unit.
const HOPS_MAX: usize = 16;

impl Settings {
    /// All likely mistakes.
    pub fn warnings(&self) -> impl Iterator<Item = Warning> {
        let rules = (0..self.routes.len()).filter_map(|n| self.rule_warning(n));
        self.ports
            .iter()
            .flatten()
            .filter_map(|port| gap_warning(port).or_else(|| off(self, port)))
            .chain(rules)
    }

    /// A likely mistake in the rule at index `n`.
    pub(crate) fn rule_warning(&self, n: usize) -> Option<Warning> {
        let rules = Rules::one(n);
        if let Some(takers) = never_matches(self, n) {
            return Some(Warning::NeverMatch { rules, takers });
        }
        if let Some((unit, port)) = no_server(self, n) {
            return Some(Warning::NoServer { rule: rules, unit, port: self.port(port)?.name.clone() });
        }
        let (server, unit) = comes_back(self, n)?;
        Some(Warning::Circle { rule: rules, unit, port: self.port(server)?.name.clone() })
    }

    /// A warning if the rule at index `n` prevents rules below it from matching.
    pub(crate) fn shadow_warning(&self, n: usize) -> Option<Warning> {
        let (mut rules, mut takers) = (Rules::default(), Rules::default());
        for below in n + 1..self.routes.len() {
            if let Some(above) = never_matches(self, below).filter(|above| above.contains(n)) {
                rules.add(below);
                takers = takers.with(above);
            }
        }
        (rules != Rules::default()).then_some(Warning::NeverMatch { rules, takers })
    }

    /// A likely mistake in the port at `id`, or in a rule that refers to it.
    pub(crate) fn port_warning(&self, id: PortId) -> Option<Warning> {
        let names =
            |(_, route): &(usize, &Route)| route.source == id || route.destination == Destination::Port(id);
        let rules = self.routes.iter().enumerate().filter(names);
        let of_rules = || rules.map(|(n, _)| n).find_map(|n| self.rule_warning(n));
        let of_port = |port| gap_warning(port).or_else(|| off(self, port));
        self.port(id).and_then(of_port).or_else(of_rules)
    }
}

/// A warning when the gap between RTU frames of `port` is shorter than specified.
fn gap_warning(port: &Port) -> Option<Warning> {
    let PortKind::Serial(SerialSettings { framing: Framing::Rtu, line, .. }) = &port.kind else {
        return None;
    };
    let (gap, t3_5) = (line.gap(), line.t3_5());
    (gap < t3_5).then(|| Warning::GapBelowSpecification { port: port.name.clone(), gap, t3_5 })
}

/// A warning if `port` is a web interface and no user has a password.
fn off(settings: &Settings, port: &Port) -> Option<Warning> {
    // Left out of images without a web interface.
    #[cfg(feature = "web")]
    if matches!(port.kind, PortKind::Http(_)) && !settings.can_log_in() {
        return Some(Warning::NobodyLogsIn { port: port.name.clone() });
    }
    let _ = (settings, port);
    None
}

/// The rules above rule `n` that match all its requests; empty if its units have another meaning at its port. `None` if requests
/// reach it, or it is the return path of another rule.
fn never_matches(settings: &Settings, n: usize) -> Option<Rules> {
    let rule = settings.routes.get(n).filter(|rule| !is_implied(settings, rule))?;
    takers(settings, n, |above| {
        let is_for_its_peers = match (above.peer, rule.peer) {
            (None, _) => true,
            (Some(above), Some(own)) => above.covers(&own),
            (Some(_), None) => false,
        };
        is_for_its_peers && (above.role.is_none() || above.role == rule.role)
    })
}

/// A unit that rule `n` sends to a port with several servers, none of which has it. A rule for all units means those that exist.
fn no_server(settings: &Settings, n: usize) -> Option<(u8, PortId)> {
    let rule = settings.routes.get(n).filter(|rule| SERVERS && !is_implied(settings, rule))?;
    let Destination::Port(client) = rule.destination else { return None };
    if !matches!(&settings.port(client)?.kind, PortKind::TcpClient(client) if client.has_lines()) {
        return None;
    }
    let mut targets = (rule.units.first..=rule.units.last).filter_map(|unit| rule.tag.apply(unit));
    let has_server = |unit: &u8| settings.server(client, *unit).is_some();
    if rule.units == UnitRange::ALL && targets.clone().any(|unit| has_server(&unit)) {
        return None;
    }
    targets.find(|unit| !has_server(unit)).map(|unit| (unit, client))
}

/// The gateway's TCP server through which requests sent by rule `n` return to that rule forever, and a unit for which they do, if
/// any.
fn comes_back(settings: &Settings, n: usize) -> Option<(PortId, u8)> {
    let rule = settings.routes.get(n)?;
    let Destination::Port(client) = rule.destination else { return None };
    // Usually false, which avoids the costly check.
    leads_back(settings, client).then_some(())?;
    let returns = |unit: &u8| {
        let start = (n, *unit);
        let hops = core::iter::successors(Some(start), |&(n, unit)| next(settings, n, unit));
        hops.skip(1).take(HOPS_MAX).any(|hop| hop == start)
    };
    let unit = (rule.units.first..=rule.units.last).find(returns)?;
    let (_, server, _) = hop(settings, client, rule.tag.apply(unit)?)?;
    Some((server, unit))
}

/// The next rule that a request reaches, and its unit there, after rule `n` has forwarded it for `unit`.
fn next(settings: &Settings, n: usize, unit: u8) -> Option<(usize, u8)> {
    let rule = settings.routes.get(n)?;
    let Destination::Port(client) = rule.destination else { return None };
    let (target, server, peer) = hop(settings, client, rule.tag.apply(unit)?)?;
    let unit = match meaning(settings, server, target) {
        Special::Rules => target,
        Special::Replace(unit) => unit,
        Special::Off | Special::Local | Special::AllLines => return None,
    };
    let takes = |route: &Route| route.matches(server, unit, Some(peer)) && !is_implied(settings, route);
    settings.routes.iter().position(takes).map(|n| (n, unit))
}

/// Whether a server of the port `client` is one of the gateway's own.
fn leads_back(settings: &Settings, client: PortId) -> bool {
    let Some(PortKind::TcpClient(TcpClientSettings { server, framing, .. })) =
        settings.port(client).map(|port| &port.kind)
    else {
        return false;
    };
    let others = settings.servers_of(client).map(|(_, server)| &server.at);
    server.iter().chain(others).any(|at| own_server(settings, at, *framing).is_some())
}

/// The destination of a request to `unit` that the port `client` sends to the gateway itself: the unit id there, the server, and
/// the client's address as far as the settings tell; the host may have other addresses.
fn hop(settings: &Settings, client: PortId, unit: u8) -> Option<(u8, PortId, IpAddr)> {
    let Some(PortKind::TcpClient(settings_of_client)) = settings.port(client).map(|port| &port.kind) else {
        return None;
    };
    let (at, target) = settings.server(client, unit)?;
    let (server, from) = own_server(settings, at, settings_of_client.framing)?;
    Some((target, server, from))
}

/// The gateway's own TCP server `at` this address, and the address from which the gateway's client reaches it.
fn own_server(settings: &Settings, at: &ServerAddress, framing: StreamFraming) -> Option<(PortId, IpAddr)> {
    let Host::Address(address) = at.host else { return None };
    let listens = |kind: &PortKind| match kind {
        PortKind::TcpServer(server) => server.listen.address == Some(address),
        PortKind::UdpServer(server) => server.listen.address == Some(address),
        _ => false,
    };
    let is_own = address.is_loopback()
        || matches!(settings.network, Some(OwnNetwork::Static(own)) if IpAddr::V4(own.address) == address)
        || settings.ports.iter().flatten().any(|port| listens(&port.kind));
    let from = match address {
        IpAddr::V4(address) if address.is_loopback() => IpAddr::V4(Ipv4Addr::LOCALHOST),
        address => address,
    };
    let is_reached = |kind: &PortKind| match kind {
        PortKind::TcpServer(server) => {
            let any = |own: IpAddr| own.is_unspecified() || own == address;
            server.listen.port == at.port
                && server.listen.address.is_none_or(any)
                && server.framing == framing
                && server.allowed.admits(from)
        }
        _ => false,
    };
    let reached =
        settings.ports.iter().position(|port| port.as_ref().is_some_and(|port| is_reached(&port.kind)))?;
    is_own.then_some((PortId(reached as u8), from))
}
