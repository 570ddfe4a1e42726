//! Resolves server names through the DNS servers set by DHCP or the settings.

use core::net::Ipv4Addr;

use embassy_net::Stack;
use embassy_net::dns::{DnsQueryType, Error, IpAddress};
use mobgate::hal::{OpenError, OpenErrorKind};

/// The address of host `name`. The caller limits the time: there may be no response.
pub(crate) async fn look_up(stack: Stack<'static>, name: &str) -> Result<Ipv4Addr, OpenError> {
    let not_found = |hint| OpenError::new(OpenErrorKind::NotFound, hint);
    if stack.config_v4().is_none_or(|own| own.dns_servers.is_empty()) {
        return Err(not_found("no name server: DHCP gives one, or network address ... dns ADDRESS"));
    }
    let addresses = stack.dns_query(name, DnsQueryType::A).await;
    let first = addresses.map(|addresses| addresses.first().copied());
    match first {
        Ok(Some(IpAddress::Ipv4(address))) => Ok(address),
        Ok(None) | Err(Error::Failed) => {
            Err(not_found("the name is not known: is it right, and does the name server respond?"))
        }
        Err(Error::InvalidName | Error::NameTooLong) => Err(not_found("that is no name of a host")),
    }
}
