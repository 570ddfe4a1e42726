//! What a table of rules does not do as it was meant: rules that never match, and requests that come back to their rule.

use core::net::{IpAddr, Ipv4Addr};

use super::{Destination, Route, Special, meaning};
use crate::config::{OwnNetwork, PortId, PortKind, Rules, Settings, StreamFraming, is_implied};

/// Hops along which a request is followed, a bound for circles with a shift in them.
const HOPS_MAX: usize = 16;

/// The rules above rule `n` (from 0) that take all requests which it would match; no rules when the units that it names mean
/// something else at its port. None when there are requests for it, or it is the way back of another rule.
pub(crate) fn never_matches(settings: &Settings, n: usize) -> Option<Rules> {
    let rule = settings.routes.get(n).filter(|rule| !is_implied(settings, rule))?;
    takers(settings, n, |above| match (above.peer, rule.peer) {
        (None, _) => true,
        (Some(above), Some(own)) => above.covers(&own),
        (Some(_), None) => false,
    })
}

/// The rules above rule `n` that take all units which it names, of those that are `for_the_same` peers.
pub(super) fn takers(settings: &Settings, n: usize, for_the_same: impl Fn(&Route) -> bool) -> Option<Rules> {
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

/// The TCP server of the gateway by which what rule `n` (from 0) sends out comes back, and the unit for which it comes to that
/// rule again, for ever, if there is one.
pub(crate) fn comes_back(settings: &Settings, n: usize) -> Option<(PortId, u8)> {
    let rule = settings.routes.get(n)?;
    let Destination::Port(client) = rule.destination else { return None };
    // Mostly that is all there is to do.
    let (server, _) = own_server(settings, client)?;
    let returns = |unit: &u8| {
        let start = (n, *unit);
        let hops = core::iter::successors(Some(start), |&(n, unit)| next(settings, n, unit));
        hops.skip(1).take(HOPS_MAX).any(|hop| hop == start)
    };
    (rule.units.first..=rule.units.last).find(returns).map(|unit| (server, unit))
}

/// The rule that a request comes to, and for which unit, when rule `n` has sent it on for `unit`.
fn next(settings: &Settings, n: usize, unit: u8) -> Option<(usize, u8)> {
    let rule = settings.routes.get(n)?;
    let Destination::Port(client) = rule.destination else { return None };
    let (server, peer) = own_server(settings, client)?;
    let target = match settings.port(client).map(|port| &port.kind) {
        Some(PortKind::TcpClient(client)) => client.unit.or_else(|| rule.tag.apply(unit))?,
        _ => return None,
    };
    let unit = match meaning(settings, server, target) {
        Special::Rules => target,
        Special::Replace(unit) => unit,
        Special::Off | Special::Local | Special::AllLines => return None,
    };
    let takes = |route: &Route| route.matches(server, unit, Some(peer)) && !is_implied(settings, route);
    settings.routes.iter().position(takes).map(|n| (n, unit))
}

/// The gateway's own TCP server to which `client` connects, and the address from which it does, as far as the settings tell:
/// the host may have other addresses.
fn own_server(settings: &Settings, client: PortId) -> Option<(PortId, IpAddr)> {
    let Some(PortKind::TcpClient(client)) = settings.port(client).map(|port| &port.kind) else { return None };
    let address = client.server.ip();
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
            server.listen.port == client.server.port()
                && server.listen.address.is_none_or(any)
                && server.framing == client.framing
                && server.framing != StreamFraming::Capture
                && server.allowed.admits(from)
        }
        _ => false,
    };
    let at =
        settings.ports.iter().position(|port| port.as_ref().is_some_and(|port| is_reached(&port.kind)))?;
    is_own.then_some((PortId(at as u8), from))
}
