//! The syslog server that gets the audit trail.

use heapless::Vec;

use crate::settings::{ServerAddress, USERS};

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

/// One server at most, and none in images without users, which have no audit trail.
pub(crate) type Syslogs = Vec<Syslog, { USERS as usize }>;
