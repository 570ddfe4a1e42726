//! The syslog server: `syslog 192.168.1.9`, `syslog tcp logs.example:601`, `syslog off`.

use core::fmt::{self, Display};

// As what uses them.
#[cfg(feature = "audit")]
use super::{
    changed::Changed,
    port_values::server_address,
    words::{Words, Wrong},
};
#[cfg(feature = "audit")]
use crate::settings::Settings;
use crate::settings::{Syslog, Transport};

/// The port of syslog by UDP (RFC 5426 3.3), and the usual one by TCP.
#[cfg(feature = "audit")]
const SYSLOG_PORT: u16 = 514;

const TRANSPORTS: &[(&str, Transport)] = &[("udp", Transport::Udp), ("tcp", Transport::Tcp)];

/// The keywords of the line.
// Without an audit trail there is no such line.
#[cfg(feature = "audit")]
pub(crate) fn keywords() -> impl Iterator<Item = &'static str> {
    TRANSPORTS.iter().map(|(word, _)| *word).chain(["off"])
}

/// `syslog ...`
#[cfg(feature = "audit")]
pub(crate) fn syslog(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    let mut word = words.take();
    let syslog = if word.is("off") {
        None
    } else {
        let transport = word.lookup(TRANSPORTS);
        if transport.is_some() {
            word = words.take();
        }
        let server = server_address(word, SYSLOG_PORT)?;
        Some(Syslog { transport: transport.unwrap_or(Transport::Udp), server })
    };
    words.end()?;
    settings.syslog.clear();
    settings.syslog.extend(syslog);
    Ok(Changed::Other)
}

impl Display for Syslog {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = TRANSPORTS
            .iter()
            .find(|(_, transport)| *transport == self.transport)
            .map_or("", |(name, _)| name);
        write!(f, "{name} {}", self.server)
    }
}
