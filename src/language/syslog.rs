//! The syslog server: `syslog 192.168.1.9`, `syslog tcp logs.example:601`, `syslog off`.

use core::fmt::{self, Display};

use super::changed::Changed;
use super::port_values::server_address;
use super::words::{Words, Wrong};
use crate::settings::{SYSLOG_PORT, Settings, Syslog, Transport};

const TRANSPORTS: &[(&str, Transport)] = &[("udp", Transport::Udp), ("tcp", Transport::Tcp)];

/// The keywords of the line.
pub(crate) fn keywords() -> impl Iterator<Item = &'static str> {
    TRANSPORTS.iter().map(|(word, _)| *word).chain(["off"])
}

/// `syslog ...`
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
