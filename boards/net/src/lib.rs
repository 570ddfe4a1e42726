//! The gateway's sockets on embassy-net, for every board that has an Ethernet of its own.
//!
//! A board makes a stack over its Ethernet driver, [`Sockets`] over the stack and a pool of buffers, and two tasks: one for
//! embassy-net's runner, one for [`Sockets::run`], [`address::follow`] and [`mdns::run`]. Its connections, ports and consoles get copies of [`TcpSockets`],
//! [`Connector`] and [`Datagrams`]; each connection and each UDP socket takes one buffer of the pool while it is open.
#![no_std]
// Where a socket's buffer is lent and taken back (`pool`), and nowhere else.
#![deny(unsafe_code)]

pub mod address;
mod closing;
mod connector;
pub mod mdns;
// One of two: images that have no names have no resolver either.
#[cfg_attr(not(feature = "servers"), path = "no_names.rs")]
mod names;
mod pool;
mod tcp;
mod udp;

pub use connector::Connector;
pub use pool::{SOCKETS_MAX, Sockets};
pub use tcp::{TcpSockets, TcpStream};
pub use udp::{Datagram, Datagrams};

/// Places that a stack's resources need besides those for [`Sockets`]: for DHCP, for multicast DNS, and for
/// look-ups of names.
pub const STACK_SOCKETS: usize = if cfg!(feature = "servers") { 3 } else { 2 };
