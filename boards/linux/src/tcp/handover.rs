//! Connections that devices have made, on their way from the tasks that accept them to the client ports that they are for.

use std::net::SocketAddr;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use mobgate::settings::{PORTS_MAX, PortId};

/// A connection of the type `C` for each port, with its peer; a newer one replaces it.
pub(super) struct Handover<C>([Signal<NoopRawMutex, (C, SocketAddr)>; PORTS_MAX]);

impl<C> Handover<C> {
    /// No connections.
    pub(super) const fn new() -> Self {
        Self([const { Signal::new() }; PORTS_MAX])
    }

    /// Hands `connection` over to `port`.
    pub(super) fn put(&self, port: PortId, connection: C, peer: SocketAddr) {
        if let Some(slot) = self.0.get(port.index()) {
            slot.signal((connection, peer));
        }
    }

    /// Waits for the next connection of `port`.
    pub(super) async fn take(&self, port: PortId) -> (C, SocketAddr) {
        match self.0.get(port.index()) {
            Some(slot) => slot.wait().await,
            None => std::future::pending().await,
        }
    }
}
