//! The board's own address: `network dhcp name cabinet-7`, `network address 192.168.1.5/24 gateway 192.168.1.1 dns 192.168.1.1`.
//!
//! For boards whose Ethernet belongs to the gateway. Refused where an operating system manages the network.

use core::fmt::{self, Display};
use core::net::Ipv4Addr;

use super::problem::Problem;
use super::values::parse_number;
use super::words::{Word, Words, Wrong};
use crate::settings::{HostName, OwnNetwork, SERVERS, StaticAddress};

/// Longest prefix of a network with room for two hosts.
const PREFIX_MAX: u32 = 30;

#[derive(Clone, Copy)]
enum Addressing {
    Dhcp,
    Static,
}

/// The options after an address.
#[derive(Clone, Copy)]
enum Behind {
    Gateway,
    Dns,
}

/// A DNS server is only needed where servers have names.
const OPTIONS: &[(&str, Behind)] = match SERVERS {
    true => &[("gateway", Behind::Gateway), ("dns", Behind::Dns)],
    false => &[("gateway", Behind::Gateway)],
};

const OPTIONS_EXPECTED: &str = if SERVERS { "gateway, dns or the end of the line" } else { "gateway" };

const ADDRESSING: &[(&str, Addressing)] = &[("dhcp", Addressing::Dhcp), ("address", Addressing::Static)];

/// The keywords of the line.
pub(crate) fn keywords() -> impl Iterator<Item = &'static str> {
    ADDRESSING.iter().map(|(word, _)| *word).chain(["name"]).chain(OPTIONS.iter().map(|(word, _)| *word))
}

/// Parses the words after `network`.
pub(crate) fn own_network(words: &Words) -> Result<OwnNetwork, Wrong> {
    let network = match words.take().keyword(ADDRESSING, "dhcp or address")? {
        Addressing::Dhcp => {
            let named = option(words, "name")?;
            OwnNetwork::Dhcp { name: named.map(host_name).transpose()?.unwrap_or_default() }
        }
        Addressing::Static => {
            let (address, prefix) = address(words.take())?;
            let mut own = StaticAddress { address, prefix, gateway: None, dns: None };
            while !words.peek().is_end() {
                let word = words.take();
                let (place, value) = match word.keyword(OPTIONS, OPTIONS_EXPECTED)? {
                    Behind::Gateway => (&mut own.gateway, gateway(words.take(), address, prefix)?),
                    Behind::Dns => (&mut own.dns, name_server(words.take())?),
                };
                if place.replace(value).is_some() {
                    return Err(word.error(Problem::Twice));
                }
            }
            OwnNetwork::Static(own)
        }
    };
    words.end()?;
    Ok(network)
}

/// The word after `keyword`, if that is next.
pub(crate) fn option<'a>(words: &'a Words, keyword: &'static str) -> Result<Option<Word<'a>>, Wrong> {
    if words.peek().is_end() {
        return Ok(None);
    }
    words.take().keyword(&[(keyword, ())], keyword)?;
    Ok(Some(words.take()))
}

pub(crate) fn host_name(word: Word) -> Result<HostName, Wrong> {
    let good = word.text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-')
        && !word.text.is_empty()
        && !word.text.starts_with('-');
    let name = if good { HostName::try_from(word.text).ok() } else { None };
    name.ok_or_else(|| word.expected("a host name: letters, digits and -, at most 32"))
}

fn address(word: Word) -> Result<(Ipv4Addr, u8), Wrong> {
    let parsed = word.text.split_once('/').and_then(|(address, prefix)| {
        let address: Ipv4Addr = address.parse().ok()?;
        let prefix = parse_number(prefix).filter(|prefix| (1..=PREFIX_MAX).contains(prefix))?;
        is_host(address, prefix).then_some((address, prefix as u8))
    });
    parsed.ok_or_else(|| word.expected("an address of a host and its prefix such as 192.168.1.5/24"))
}

fn gateway(word: Word, own: Ipv4Addr, prefix: u8) -> Result<Ipv4Addr, Wrong> {
    let gateway: Option<Ipv4Addr> = word.text.parse().ok();
    let gateway = gateway.ok_or_else(|| word.expected("the gateway's address such as 192.168.1.1"))?;
    let mask = mask(prefix.into());
    let near = gateway.to_bits() & mask == own.to_bits() & mask;
    if near && gateway != own && is_host(gateway, prefix.into()) {
        Ok(gateway)
    } else {
        Err(word.error(Problem::GatewayOutside))
    }
}

fn name_server(word: Word) -> Result<Ipv4Addr, Wrong> {
    let address: Option<Ipv4Addr> = word.text.parse().ok();
    let address = address.filter(|address| !address.is_unspecified() && !address.is_multicast());
    address.ok_or_else(|| word.expected("the name server's address such as 192.168.1.1"))
}

fn mask(prefix: u32) -> u32 {
    u32::MAX.checked_shl(32 - prefix).unwrap_or(0)
}

/// Whether `address` can be a host: not the network or broadcast address, and not reserved.
fn is_host(address: Ipv4Addr, prefix: u32) -> bool {
    let host = address.to_bits() & !mask(prefix);
    host != 0
        && host != !mask(prefix)
        && !address.is_multicast()
        && !address.is_loopback()
        && address.octets()[0] != 0
}

impl Display for StaticAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.address, self.prefix)
    }
}

impl Display for OwnNetwork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Dhcp { name } if name.is_empty() => f.write_str("dhcp"),
            Self::Dhcp { name } => write!(f, "dhcp name {name}"),
            Self::Static(own) => {
                write!(f, "address {own}")?;
                own.gateway.map_or(Ok(()), |gateway| write!(f, " gateway {gateway}"))?;
                own.dns.map_or(Ok(()), |dns| write!(f, " dns {dns}"))
            }
        }
    }
}
