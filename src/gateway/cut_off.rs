//! Whether new settings would lock out the user who commits them, who could then not revert them. Pure.

use core::net::IpAddr;

use super::audit::Actor;
use crate::settings::{
    Allowed, PortId, PortKind, Settings, StreamFraming, TcpListen, TcpServerSettings, User,
};

/// Why a change of the settings is refused.
pub(crate) type CutOff = &'static str;

/// Why `after` would lock out `actor`, who is connected through `port`, if that is one of the settings. The local console is always
/// open, and whoever has not logged in changes nothing.
pub(crate) fn cut_off(
    before: &Settings,
    after: &Settings,
    actor: Actor<'_>,
    port: Option<PortId>,
) -> Option<CutOff> {
    let Actor::User { name, peer } = actor else { return None };
    let entrance = port.and_then(|port| Entrance::of(before, port));
    entrance
        .and_then(|entrance| unreachable(&entrance, after, peer))
        .or_else(|| unknown(before.user(name)?, after.user(name)))
        .or_else(|| (before.own_network() != after.own_network()).then_some("the network is another"))
}

/// A port by which sessions come in.
struct Entrance<'s> {
    listen: TcpListen,
    /// `None`: HTTP.
    framing: Option<StreamFraming>,
    allowed: &'s Allowed,
    /// Other machines may use it.
    is_open: bool,
}

impl<'s> Entrance<'s> {
    fn of(settings: &'s Settings, port: PortId) -> Option<Self> {
        match &settings.port(port)?.kind {
            PortKind::TcpServer(TcpServerSettings { listen, framing, allowed, .. }) => {
                Some(Self { listen: *listen, framing: Some(*framing), allowed, is_open: true })
            }
            // Images without a web interface have no such port.
            #[cfg(feature = "web")]
            PortKind::Http(server) => Some(Self {
                listen: server.listen,
                framing: None,
                allowed: &server.allowed,
                is_open: server.cleartext || server.is_encrypted(),
            }),
            _ => None,
        }
    }

    /// Whether it replaces `old`.
    fn replaces(&self, old: &Self) -> bool {
        let is_everywhere = self.listen.address.is_none() && self.listen.port == old.listen.port;
        self.framing == old.framing && (self.listen == old.listen || is_everywhere)
    }
}

/// Why `peer` could not connect again as it did through `old`.
fn unreachable(old: &Entrance<'_>, after: &Settings, peer: IpAddr) -> Option<CutOff> {
    let mut entrances = (0..after.ports.len()).filter_map(|at| Entrance::of(after, PortId(at as u8)));
    match entrances.find(|new| new.replaces(old)) {
        None => Some("no port is where you came in"),
        Some(new) if !new.allowed.admits(peer) => Some("your address is not allowed any more"),
        Some(new) if !new.is_open && !peer.is_loopback() => {
            Some("other machines may not use the port any more")
        }
        Some(_) => None,
    }
}

/// Why the user could no longer log in.
fn unknown(before: &User, after: Option<&User>) -> Option<CutOff> {
    match after {
        None => Some("your user is gone"),
        Some(after) if after.role < before.role => Some("your role is a lower one"),
        Some(after) if after.password != before.password => Some("your password is another"),
        Some(after) if before.keys.iter().any(|key| !after.keys.contains(key)) => {
            Some("a key of yours is gone")
        }
        Some(_) => None,
    }
}
