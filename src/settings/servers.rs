//! The servers of a TCP client that has several: their addresses and units.

use core::fmt::{self, Display};
use core::net::{IpAddr, SocketAddr};

use heapless::String;

use crate::settings::{Endpoint, PortId, Tag, UnitRange};

/// Whether ports can have several servers, and servers can have names. Without the feature `servers` the image has neither the code
/// nor the memory for it.
pub(crate) const SERVERS: bool = cfg!(feature = "servers");

/// Server lines of all ports together.
pub(crate) const SERVERS_MAX: usize = match (SERVERS, cfg!(feature = "small")) {
    (false, _) => 0,
    (true, true) => 16,
    (true, false) => 128,
};

pub(crate) const PORT_SERVERS_MAX: usize = match (SERVERS, cfg!(feature = "small")) {
    (false, _) => 1,
    (true, true) => 8,
    (true, false) => 64,
};

/// Simultaneous connections of a port.
pub const SOCKETS_MAX: usize = match (SERVERS, cfg!(feature = "small")) {
    (false, _) => 1,
    (true, true) => 2,
    (true, false) => 16,
};

/// Longest name of a server in bytes; with the feature `small` shorter than a DNS label may be.
pub(crate) const SERVER_NAME_BYTES_MAX: usize = if cfg!(feature = "small") { 31 } else { 63 };

/// A server's name, resolved by DNS.
pub type ServerName = String<SERVER_NAME_BYTES_MAX, u8>;

/// The machine that a server runs on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Host {
    /// By its address.
    Address(IpAddr),
    /// A name, resolved whenever a connection is opened.
    Name(ServerName),
}

/// The address of a server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerAddress {
    /// The machine.
    pub host: Host,
    /// The TCP port number.
    pub port: u16,
}

impl From<SocketAddr> for ServerAddress {
    fn from(address: SocketAddr) -> Self {
        Self { host: Host::Address(address.ip()), port: address.port() }
    }
}

impl Display for ServerAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.host {
            Host::Address(address) => Endpoint(SocketAddr::new(*address, self.port)).fmt(f),
            Host::Name(name) => write!(f, "{name}:{}", self.port),
        }
    }
}

/// One of several servers behind a port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerSettings {
    /// The port.
    pub port: PortId,
    /// The units behind it, by the port's numbering.
    pub units: UnitRange,
    /// Where it is.
    pub at: ServerAddress,
    /// Translation of the unit id for this server.
    pub tag: Tag,
}
