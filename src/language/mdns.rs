//! Discovery by multicast DNS: `mdns on name cabinet-7`, `mdns off`.
//!
//! It announces (RFC 6762) the gateway's Modbus TCP servers (`_modbus._tcp`, RFC 6763).

use core::fmt::{self, Display};

use super::own_network::{host_name, option};
use super::words::{Words, Wrong};
use crate::settings::Mdns;

const SWITCH: &[(&str, bool)] = &[("on", true), ("off", false)];

/// The keywords of the line.
pub(crate) fn keywords() -> impl Iterator<Item = &'static str> {
    SWITCH.iter().map(|(word, _)| *word).chain(["name"])
}

/// Parses the words after `mdns`.
pub(crate) fn mdns(words: &Words) -> Result<Mdns, Wrong> {
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
