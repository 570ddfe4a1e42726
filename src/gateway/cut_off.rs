//! Whether new settings would lock out the user who commits them, who could then not revert them. Pure.

use core::net::IpAddr;

use super::audit::{Actor, Way};
use crate::settings::{
    Allowed, PortId, PortKind, SSH, Settings, StreamFraming, TcpListen, TcpServerSettings, User,
};
// As what uses them.
#[cfg(feature = "tls")]
use crate::settings::{Certificate, Purpose, TlsSettings};

/// Why a change of the settings is refused.
pub(crate) type CutOff = &'static str;

/// Why `after` would lock out `actor`, who has come in by `way`. The local console is always open, and whoever has not logged in
/// changes nothing.
pub(crate) fn cut_off(
    before: &Settings,
    after: &Settings,
    actor: Actor<'_>,
    Way { port, by_name }: Way,
) -> Option<CutOff> {
    let Actor::User { name, peer } = actor else { return None };
    let entrance = port.and_then(|port| Entrance::of(before, port));
    let is_elsewhere =
        || before.own_network() != after.own_network() || (by_name && before.mdns != after.mdns);
    entrance
        .and_then(|entrance| unreachable(&entrance, after, peer))
        .or_else(|| unknown(before.user(name)?, after.user(name)))
        .or_else(|| is_elsewhere().then_some("the gateway's address or name is another"))
}

/// A port by which sessions come in.
struct Entrance<'s> {
    listen: TcpListen,
    /// `None`: HTTP.
    framing: Option<StreamFraming>,
    allowed: &'s Allowed,
    /// Other machines may use it.
    is_open: bool,
    /// How it is encrypted, if it is, and the settings with its certificates. A browser gives a cookie of HTTPS to nothing else.
    // Left out of images without TLS; also below.
    #[cfg(feature = "tls")]
    tls: Option<(&'s TlsSettings, &'s Settings)>,
}

impl<'s> Entrance<'s> {
    fn of(settings: &'s Settings, port: PortId) -> Option<Self> {
        let kind = &settings.port(port)?.kind;
        // As the field.
        #[cfg(feature = "tls")]
        let tls = kind.tls().map(|tls| (tls, settings));
        match kind {
            PortKind::TcpServer(TcpServerSettings { listen, framing, allowed, .. }) => Some(Self {
                listen: *listen,
                framing: Some(*framing),
                allowed,
                is_open: true,
                #[cfg(feature = "tls")]
                tls,
            }),
            // Images without a web interface have no such port.
            #[cfg(feature = "web")]
            PortKind::Http(server) => Some(Self {
                listen: server.listen,
                framing: None,
                allowed: &server.allowed,
                is_open: server.cleartext || server.is_encrypted(),
                #[cfg(feature = "tls")]
                tls,
            }),
            _ => None,
        }
    }

    /// Whether it replaces `old`.
    fn replaces(&self, old: &Self) -> bool {
        let is_everywhere = self.listen.address.is_none() && self.listen.port == old.listen.port;
        self.framing == old.framing && (self.listen == old.listen || is_everywhere)
    }

    /// Whether `peer` may use it.
    fn admits(&self, peer: IpAddr) -> bool {
        self.allowed.admits(peer) && (self.is_open || peer.is_loopback())
    }

    /// Whether it is encrypted as `old` is, by the same certificates, or like it not at all.
    #[cfg(feature = "tls")]
    fn is_encrypted_as(&self, old: &Self) -> bool {
        match (self.tls, old.tls) {
            (Some((new, after)), Some((old, before))) => new == old && used(new, after).eq(used(old, before)),
            (new, old) => new.is_none() && old.is_none(),
        }
    }
}

/// The certificates that a server with TLS uses: its own one, and those that it trusts, if it names some.
#[cfg(feature = "tls")]
fn used<'s>(tls: &'s TlsSettings, settings: &'s Settings) -> impl Iterator<Item = &'s Certificate> {
    let own = settings.certificates_for(Purpose::Own, tls.certificate.as_deref()).take(1);
    let trusted = tls.trust.as_deref().into_iter();
    own.chain(trusted.flat_map(|name| settings.certificates_for(Purpose::Clients, Some(name))))
}

/// Why `peer` could not connect again as it did through `old`.
fn unreachable(old: &Entrance<'_>, after: &Settings, peer: IpAddr) -> Option<CutOff> {
    let mut entrances = (0..after.ports.len()).filter_map(|at| Entrance::of(after, PortId(at as u8)));
    match entrances.find(|new| new.replaces(old)) {
        None => Some("no port is where you came in"),
        Some(new) if !new.admits(peer) => Some("your address may not use the port any more"),
        #[cfg(feature = "tls")]
        Some(new) if !new.is_encrypted_as(old) => Some("the TLS of the port, or a certificate, is another"),
        Some(_) => None,
    }
}

/// Why the user could no longer log in.
fn unknown(before: &User, after: Option<&User>) -> Option<CutOff> {
    match after {
        None => Some("your user is gone"),
        Some(after) if after.role < before.role => Some("your role is a lower one"),
        Some(after) if after.password != before.password => Some("your password is another"),
        Some(after) if SSH && before.keys.iter().any(|key| !after.keys.contains(key)) => {
            Some("a key of yours is gone")
        }
        Some(_) => None,
    }
}

#[cfg(test)]
// Other images have no such ports.
#[cfg(all(feature = "web", feature = "tls"))]
mod tests {
    extern crate std;
    use std::string::String;

    use super::*;
    use crate::language::apply;

    const PEER: IpAddr = IpAddr::V4(core::net::Ipv4Addr::new(10, 0, 0, 1));
    const HERE: IpAddr = IpAddr::V4(core::net::Ipv4Addr::LOCALHOST);
    const WEB: &str = "port web http server 443";

    fn settings(lines: &[&str]) -> Settings {
        let mut settings = Settings::new();
        let common = [
            "user anna role engineer",
            "certificate one own /one.pem key /one.key",
            "certificate two own /two.pem key /two.key",
            "certificate ca clients /ca.pem",
        ];
        for line in common.iter().chain(lines) {
            apply(&mut settings, line).unwrap();
        }
        settings
    }

    /// What anna at `peer`, who has come to [`WEB`] perhaps by the mDNS name, is told when she changes the lines `old` by `new`.
    fn told(peer: IpAddr, by_name: bool, old: &[&str], new: &[&str]) -> Option<CutOff> {
        let (before, mut after) = (settings(old), settings(old));
        for line in new {
            apply(&mut after, line).unwrap();
        }
        let actor = Actor::User { name: "anna", peer };
        cut_off(&before, &after, actor, Way { port: before.find("web"), by_name })
    }

    fn web(options: &str) -> String {
        [WEB, options].join(" ")
    }

    #[test]
    fn a_port_that_takes_up_or_leaves_off_encryption_cuts_off_and_so_does_another_certificate() {
        const TLS: Option<CutOff> = Some("the TLS of the port, or a certificate, is another");
        const ADDRESS: Option<CutOff> = Some("your address may not use the port any more");
        for (old, new, why) in [
            ("cleartext", "tls", TLS),
            ("cleartext", "tls cleartext", TLS),
            ("tls", "cleartext", TLS),
            ("tls", "", ADDRESS),
            ("tls", "tls trust ca", TLS),
            ("tls", "tls certificate two", TLS),
            ("tls", "tls cleartext metrics allow 10.0.0.0/8", None),
            ("tls cleartext", "tls", None),
            ("cleartext", "", ADDRESS),
            ("cleartext", "cleartext metrics", None),
        ] {
            assert_eq!(told(PEER, false, &[&web(old)], &[&web(new)]), why, "{old:?} -> {new:?}");
        }
        // From the machine itself nothing need be encrypted, but a cookie of HTTPS stays there.
        assert_eq!(told(HERE, false, &[&web("cleartext")], &[WEB]), None);
        assert_eq!(told(HERE, false, &[&web("tls")], &[WEB]), TLS);
        for (line, why) in [
            ("certificate one own /other.pem key /one.key", TLS),
            ("delete certificate one", TLS),
            // The port uses none of these.
            ("delete certificate two", None),
            ("delete certificate ca", None),
            ("certificate three own /three.pem key /three.key", None),
        ] {
            assert_eq!(told(PEER, false, &[&web("tls")], &[line]), why, "{line}");
            assert_eq!(told(PEER, false, &[&web("cleartext")], &[line]), None, "{line}");
        }
        // Names are the same in capitals.
        let trusts = [&*web("tls certificate TWO trust CA")];
        assert_eq!(told(PEER, false, &trusts, &["certificate ca clients /other.pem"]), TLS);
        assert_eq!(told(PEER, false, &trusts, &["certificate two own /other.pem key /two.key"]), TLS);
        assert_eq!(told(PEER, false, &trusts, &["certificate one own /other.pem key /one.key"]), None);
    }

    #[test]
    fn another_mdns_name_or_none_cuts_off_who_has_come_by_the_name() {
        let old = [&*web("cleartext"), "mdns on name cabinet"];
        for line in ["mdns on name cabinet-2", "mdns on", "mdns off"] {
            let why = Some("the gateway's address or name is another");
            assert_eq!(told(PEER, true, &old, &[line]), why, "{line}");
            assert_eq!(told(PEER, false, &old, &[line]), None, "{line}");
        }
        assert_eq!(told(PEER, true, &old, &["mdns on name cabinet", "port P502 tcp server 502"]), None);
    }

    #[test]
    fn an_address_that_is_not_allowed_any_more_is_cut_off() {
        let old = [&*web("cleartext allow 10.0.0.0/8")];
        for (new, is_refused) in [
            ("cleartext allow 10.0.0.2", true),
            ("cleartext allow 10.0.0.2,10.0.0.1", false),
            ("cleartext", false),
        ] {
            assert_eq!(told(PEER, false, &old, &[&web(new)]).is_some(), is_refused, "{new}");
        }
    }
}
