//! The two sides of the protocol.

/// Which side of the protocol a port plays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Sends requests to outside servers (the gateway is the master).
    Client,
    /// Brings requests to the gateway: it answers an outside client (the gateway is a slave), or asks by itself.
    Server,
}
