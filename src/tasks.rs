//! The futures that a board runs as its tasks: the router, one per port, one per TCP connection, and the audit trail to a syslog server.

mod connection;
mod port;
mod router;
// Images without an audit trail send nothing.
#[cfg(feature = "audit")]
mod syslog;
