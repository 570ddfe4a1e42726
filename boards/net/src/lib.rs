//! The gateway's sockets on embassy-net, for boards with their own Ethernet.
//!
//! A board creates a [`Backlog`], a stack over its Ethernet driver as [`Queued`], [`Sockets`] over the stack and a pool of buffers, and
//! two tasks: one for embassy-net's runner, one for [`Sockets::run`], [`address::follow`] and [`mdns::run`]. Its connections, ports
//! and consoles get copies of [`TcpSockets`], [`Connector`] and [`Datagrams`]; each open connection or UDP socket takes one buffer of
//! the pool.
#![no_std]
// Allowed only where a socket's buffer is lent and returned (`pool`).
#![deny(unsafe_code)]

pub mod address;
// Images without an audit trail have nothing to send, and need no time for it.
#[cfg(feature = "audit")]
mod audit;
mod backlog;
mod closing;
mod connector;
// Images without it have no console by network; also below.
#[cfg(feature = "ssh")]
mod lobby;
pub mod mdns;
// Images without server names need no resolver.
#[cfg_attr(not(feature = "servers"), path = "no_names.rs")]
mod names;
mod pool;
mod queued;
#[cfg(feature = "audit")]
mod sntp;
// Images without it have no console by network.
#[cfg(feature = "ssh")]
mod ssh;
mod syn;
#[cfg(feature = "audit")]
mod syslog;
mod tcp;
mod udp;

#[cfg(feature = "audit")]
pub use audit::follow_audit;
pub use backlog::Backlog;
pub use connector::Connector;
#[cfg(feature = "ssh")]
pub use lobby::SSH_SESSIONS_MAX;
pub use pool::Sockets;
pub use queued::{Queued, Received};
pub use tcp::{TcpSockets, TcpStream};
pub use udp::{Datagram, Datagrams};

/// Sockets that a stack's resources need besides those of [`Sockets`]: DHCP, multicast DNS, DNS look-ups, syslog and time.
pub const STACK_SOCKETS: usize =
    2 + cfg!(feature = "servers") as usize + 2 * cfg!(feature = "audit") as usize;

/// Most sockets in a pool.
pub const SOCKETS_MAX: usize = if cfg!(feature = "web") { 32 } else { 24 };
