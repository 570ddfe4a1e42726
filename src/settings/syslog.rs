//! The syslog server that gets the audit trail, and the NTP server for the time of its lines.

use heapless::Vec;

use crate::settings::ServerAddress;

/// Whether there is an audit trail. Without the feature `audit` the image has neither the code nor the memory for it.
pub(crate) const AUDIT: bool = cfg!(feature = "audit");

/// How messages travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transport {
    /// A datagram for each message (RFC 5426).
    Udp,
    /// Messages with their lengths (RFC 6587 3.4.1).
    Tcp,
}

/// A syslog server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Syslog {
    /// How messages travel.
    pub transport: Transport,
    /// The server.
    pub server: ServerAddress,
}

/// One server at most, and none in images without an audit trail.
pub(crate) type Syslogs = Vec<Syslog, { AUDIT as usize }>;

/// The NTP server likewise.
pub(crate) type NtpServers = Vec<ServerAddress, { AUDIT as usize }>;
