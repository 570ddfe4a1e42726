//! The two sides of the protocol.

/// The side of the protocol that a port is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Sends requests to outside servers (the gateway is the master).
    Client,
    /// Brings requests to the gateway: from an outside client (the gateway is a slave), or its own.
    Server,
}
