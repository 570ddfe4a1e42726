//! Connections that devices have made, on their way from the tasks that accept them to the client ports that they are for.

use std::net::SocketAddr;
use std::rc::Rc;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use mobgate::settings::{PORTS_MAX, PortId};

use super::TcpStream;

/// A connection that waits for its port; a newer one replaces it.
type Slot = Signal<NoopRawMutex, (TcpStream, SocketAddr)>;

thread_local! {
    static SLOTS: Rc<[Slot; PORTS_MAX]> = Rc::new([const { Slot::new() }; PORTS_MAX]);
}

/// Hands `stream` over to `port`.
pub(super) fn put(port: PortId, stream: TcpStream, peer: SocketAddr) {
    let slots = SLOTS.with(Rc::clone);
    if let Some(slot) = slots.get(port.index()) {
        slot.signal((stream, peer));
    }
}

/// Waits for the next connection of `port`.
pub(super) async fn take(port: PortId) -> (TcpStream, SocketAddr) {
    let slots = SLOTS.with(Rc::clone);
    match slots.get(port.index()) {
        Some(slot) => slot.wait().await,
        None => std::future::pending().await,
    }
}
