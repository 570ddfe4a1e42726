//! Tells addresses of private networks from those that the whole world reaches.

use std::net::IpAddr;

use mobgate::settings::TcpListen;
use nix::ifaddrs::getifaddrs;

/// An address of this machine at which `listen` is reached from outside private networks, if there is one.
pub(crate) fn public_address(listen: &TcpListen) -> Option<IpAddr> {
    match listen.address.filter(|address| !address.is_unspecified()) {
        Some(address) => Some(address).filter(|address| !is_private(address)),
        None => own_addresses().find(|address| !is_private(address)),
    }
}

fn own_addresses() -> impl Iterator<Item = IpAddr> {
    getifaddrs().into_iter().flatten().filter_map(|interface| {
        let address = interface.address?;
        let v4 = address.as_sockaddr_in().map(|address| address.ip().into());
        v4.or_else(|| address.as_sockaddr_in6().map(|address| address.ip().into()))
    })
}

/// Loopback, link-local and private addresses (RFC 1918, RFC 4193), and those that providers share among their customers (RFC 6598).
fn is_private(address: &IpAddr) -> bool {
    match address.to_canonical() {
        IpAddr::V4(address) => {
            let [first, second, ..] = address.octets();
            let is_shared = first == 100 && second & 0xc0 == 64;
            address.is_loopback() || address.is_link_local() || address.is_private() || is_shared
        }
        IpAddr::V6(address) => {
            address.is_loopback() || address.is_unicast_link_local() || address.is_unique_local()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_that_the_world_reaches_are_told_from_others() {
        let private = "127.0.0.1 10.1.2.3 172.16.0.1 172.31.255.255 192.168.0.1 169.254.1.1 100.64.0.1 \
                       100.127.255.255 ::1 fe80::1 fd00::1 ::ffff:10.0.0.1";
        let public = "8.8.8.8 172.15.0.1 172.32.0.1 192.169.0.1 100.63.0.1 100.128.0.1 11.0.0.1 \
                      2001:db8::1 ::ffff:9.9.9.9";
        for address in private.split(' ') {
            assert!(is_private(&address.parse().unwrap()), "{address}");
        }
        for address in public.split(' ') {
            assert!(!is_private(&address.parse().unwrap()), "{address}");
        }
    }
}
