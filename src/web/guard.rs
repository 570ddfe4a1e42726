//! Refuses requests that a page of another origin makes a browser send.
//!
//! A browser names the host it addresses (`Host`) and the origin of the page (`Origin`, `Sec-Fetch-Site`). Against DNS rebinding, only the
//! gateway's addresses, `localhost` and its mDNS name are accepted as hosts. State-changing requests with a cookie must name their
//! origin.

use picoserve::request::Headers;

use crate::settings::{IPV6, Settings};

/// Why a request is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Foreign {
    #[error("one Host header is needed, with an address of the gateway, localhost or its mDNS name")]
    Host,
    #[error("a page of another origin may not do this")]
    Origin,
    #[error("with a cookie, this needs the Origin header")]
    NoOrigin,
}

/// The only header of this name; an error if there are several.
fn only<'r>(headers: Headers<'r>, name: &str) -> Result<Option<&'r str>, ()> {
    let mut values = headers.iter().filter(|(known, _)| *known == name).map(|(_, value)| value);
    let value = values.next();
    if values.next().is_some() {
        return Err(());
    }
    value.map(|value| value.as_str().map_err(|_| ())).transpose()
}

/// Checks the host of a request, and returns it, and whether it is the mDNS name. With TLS (`encrypted`) it may be any: the browser has
/// checked it against the certificate.
pub(super) fn check_host<'r>(
    headers: Headers<'r>,
    settings: &Settings,
    encrypted: bool,
) -> Result<(&'r str, bool), Foreign> {
    let host = only(headers, "host").ok().flatten().ok_or(Foreign::Host)?;
    let by_name = own(host, settings).or(encrypted.then_some(false));
    Ok((host, by_name.ok_or(Foreign::Host)?))
}

/// Checks the host and the origin of a request, and returns whether the host is the mDNS name.
pub(super) fn check(headers: Headers<'_>, settings: &Settings, encrypted: bool) -> Result<bool, Foreign> {
    let (host, by_name) = check_host(headers, settings, encrypted)?;
    let origin = only(headers, "origin").map_err(|()| Foreign::Origin)?;
    let is_same = |origin: &str| {
        let from = origin.strip_prefix(if encrypted { "https://" } else { "http://" });
        from.is_some_and(|from| from.eq_ignore_ascii_case(host))
    };
    let site = only(headers, "sec-fetch-site").map_err(|()| Foreign::Origin)?;
    let is_near = site.is_none_or(|site| site == "same-origin" || site == "none");
    (origin.is_none_or(is_same) && is_near).then_some(by_name).ok_or(Foreign::Origin)
}

/// Checks that a request that a cookie allows to change something was sent by a page of this origin.
pub(super) fn check_cookie(headers: Headers<'_>) -> Result<(), Foreign> {
    headers.get("origin").map(|_| ()).ok_or(Foreign::NoOrigin)
}

/// Whether `host`, perhaps with a port, is the gateway by its mDNS name; `None` if it is not the gateway.
fn own(host: &str, settings: &Settings) -> Option<bool> {
    let name = match host.strip_prefix('[') {
        Some(host) => {
            let (address, rest) = host.split_once(']')?;
            let is_own = IPV6 && is_port(rest) && address.parse::<core::net::Ipv6Addr>().is_ok();
            return is_own.then_some(false);
        }
        None => match host.split_once(':') {
            Some((name, port)) if is_port_number(port) => name,
            Some(_) => return None,
            None => host,
        },
    };
    let local = name.len().checked_sub(".local".len()).and_then(|at| name.split_at_checked(at));
    let by_name = local.is_some_and(|(name, local)| {
        let own = settings.mdns_name("");
        local.eq_ignore_ascii_case(".local") && own.is_some_and(|own| own.eq_ignore_ascii_case(name))
    });
    let is_own =
        by_name || name.eq_ignore_ascii_case("localhost") || name.parse::<core::net::Ipv4Addr>().is_ok();
    is_own.then_some(by_name)
}

fn is_port(text: &str) -> bool {
    text.is_empty() || text.strip_prefix(':').is_some_and(is_port_number)
}

fn is_port_number(text: &str) -> bool {
    text.bytes().all(|byte| byte.is_ascii_digit()) && text.parse::<u16>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::language::apply;

    #[test]
    fn addresses_localhost_and_the_mdns_name_are_the_gateway_and_other_names_are_not() {
        let mut settings = Settings::new();
        assert_eq!(own("cabinet.local", &settings), None);
        apply(&mut settings, "mdns on name cabinet").unwrap();
        for host in [
            "127.0.0.1",
            "192.168.1.5:8080",
            "localhost",
            "LOCALHOST:80",
            "[::1]",
            "[fe80::1]:8080",
            "cabinet.local",
            "Cabinet.Local:80",
        ] {
            assert_eq!(
                own(host, &settings),
                Some(host.to_ascii_lowercase().starts_with("cabinet.")),
                "{host}"
            );
        }
        for host in [
            "",
            "evil.example",
            "evil.example:80",
            "localhost.evil.example",
            "127.0.0.1.evil.example",
            "cabinet",
            "xcabinet.local",
            ".local",
            "é.local",
            "localhost:",
            "localhost:x",
            "localhost:99999",
            "[::1",
            "[::1]x",
            "[127.0.0.1]",
            "::1",
            "user@localhost",
        ] {
            assert_eq!(own(host, &settings), None, "{host}");
        }
    }
}
