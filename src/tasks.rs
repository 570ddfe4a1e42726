//! The futures that a board runs as its tasks: the router, one per port, one per TCP connection, one for the brokers that get data
//! points, and the audit trail to a syslog server.

mod connection;
mod port;
// As the feature.
#[cfg(feature = "mqtt")]
mod publish;
mod router;
// Images without an audit trail send nothing.
#[cfg(feature = "audit")]
mod syslog;
