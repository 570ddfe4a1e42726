//! How the gateway is found on the network: `mdns on name cabinet-7`, `mdns off`.
//!
//! By multicast DNS (RFC 6762) it tells whoever asks which Modbus TCP servers it has (`_modbus._tcp`, RFC 6763).

use core::fmt::{self, Display};
use core::net::Ipv4Addr;

use super::own_network::{HostName, host_name, option};
use super::words::{Words, Wrong};
use super::{OwnNetwork, PortKind, Settings, StreamFraming};

/// Whether the gateway can be found, and by which name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mdns {
    /// It answers.
    On {
        /// The name of the gateway; when empty, the one that the board tells its DHCP server, or else the machine's.
        name: HostName,
    },
    /// It is silent.
    Off,
}

impl Mdns {
    /// What a gateway starts with.
    pub const DEFAULT: Self = Self::On { name: HostName::new() };
}

impl Default for Mdns {
    fn default() -> Self {
        Self::DEFAULT
    }
}

const SWITCH: &[(&str, bool)] = &[("on", true), ("off", false)];

/// The words that stand in the line.
pub(crate) fn keywords() -> impl Iterator<Item = &'static str> {
    SWITCH.iter().map(|(word, _)| *word).chain(["name"])
}

/// Reads what stands behind `mdns`.
pub(super) fn mdns(words: &Words) -> Result<Mdns, Wrong> {
    let mdns = if words.take().keyword(SWITCH, "on or off")? {
        let named = option(words, "name")?;
        Mdns::On { name: named.map(host_name).transpose()?.unwrap_or_default() }
    } else {
        Mdns::Off
    };
    words.end()?;
    Ok(mdns)
}

impl Display for Mdns {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::On { name } if name.is_empty() => f.write_str("on"),
            Self::On { name } => write!(f, "on name {name}"),
            Self::Off => f.write_str("off"),
        }
    }
}

impl Settings {
    /// The name under which the gateway is found, which is `own` unless the settings say another; `None` when it is not to be
    /// found.
    pub fn mdns_name<'s>(&'s self, own: &'s str) -> Option<&'s str> {
        let Mdns::On { name } = &self.mdns else { return None };
        let told = match &self.network {
            Some(OwnNetwork::Dhcp { name }) => name.as_str(),
            _ => "",
        };
        [name, told, own].into_iter().find(|name| !name.is_empty())
    }

    /// The TCP ports of the Modbus TCP servers that can be reached at `own`, with the names of their ports.
    pub fn modbus_servers(&self, own: Ipv4Addr) -> impl Iterator<Item = (&str, u16)> {
        self.ports.iter().flatten().filter_map(move |port| match &port.kind {
            PortKind::TcpServer(server) if server.framing == StreamFraming::Mbap => {
                let at = server.listen.address.unwrap_or(own.into());
                (at.is_unspecified() || at.to_canonical() == own)
                    .then_some((port.name.as_str(), server.listen.port))
            }
            _ => None,
        })
    }
}
