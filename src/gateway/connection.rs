//! The shared state of a TCP connection slot: the connected client, and signals to it.

use core::cell::RefCell;
use core::net::SocketAddr;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

use super::shared::Shared;
use crate::frame::Channel;
use crate::settings::{ClientRole, PortId};

/// The shared state of a TCP connection slot.
pub struct Connection {
    /// Responses for the connection; only the router sends, only the connection receives.
    pub(crate) responses: Channel,
    /// The slot was assigned to another port, or its port has changed.
    pub(crate) changed: Signal<CriticalSectionRawMutex, ()>,
    /// The connection must close to make room.
    pub(crate) leave: Signal<CriticalSectionRawMutex, ()>,
    state: Shared<ConnectionState>,
}

/// The client on a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConnectionState {
    /// The TCP server that the slot is assigned to.
    pub port: Option<PortId>,
    /// The connected client.
    pub peer: Option<SocketAddr>,
    /// The role in the client's certificate.
    pub role: ClientRole,
    /// Whether the client may use reserved connections.
    pub marked: bool,
    /// Whether the connection has been told to close.
    pub leaving: bool,
    /// Counts the clients of this slot.
    pub generation: u16,
    /// When the client connected.
    pub since: Instant,
    /// When its last request, or a part of one, arrived, or the client connected.
    pub last_request: Instant,
    /// Requests without a response so far.
    pub open_requests: u8,
    /// Requests from this client.
    pub requests: u32,
}

impl ConnectionState {
    pub(crate) const EMPTY: Self = Self {
        port: None,
        peer: None,
        role: ClientRole::NONE,
        marked: false,
        leaving: false,
        generation: 0,
        since: Instant::MIN,
        last_request: Instant::MIN,
        open_requests: 0,
        requests: 0,
    };
}

impl Connection {
    /// An unused slot.
    pub const fn new() -> Self {
        Self {
            responses: Channel::new(),
            changed: Signal::new(),
            leave: Signal::new(),
            state: Mutex::new(RefCell::new(ConnectionState::EMPTY)),
        }
    }

    /// Assigns the slot to `port`, or unassigns it.
    pub(super) fn assign(&self, port: Option<PortId>) {
        self.update(|connection| connection.port = port);
        self.changed.signal(());
    }

    /// Notes that the client `peer` has connected, with a `role`, and whether it is `marked`; returns the slot's new generation.
    pub(crate) fn enter(&self, peer: SocketAddr, role: ClientRole, marked: bool) -> u16 {
        let now = Instant::now();
        self.leave.reset();
        self.update(|connection| {
            let (port, generation) = (connection.port, connection.generation.wrapping_add(1));
            let fresh = ConnectionState { since: now, last_request: now, ..ConnectionState::EMPTY };
            *connection = ConnectionState { port, peer: Some(peer), role, marked, generation, ..fresh };
            generation
        })
    }

    /// Tells the client to leave; returns its address.
    pub(crate) fn displace(&self) -> Option<SocketAddr> {
        self.leave.signal(());
        self.update(|connection| {
            connection.leaving = true;
            connection.peer
        })
    }

    /// The state of the slot's client.
    pub fn state(&self) -> ConnectionState {
        self.update(|state| *state)
    }

    /// Calls `change` with the client's state.
    pub(crate) fn update<R>(&self, change: impl FnOnce(&mut ConnectionState) -> R) -> R {
        self.state.lock(|state| change(&mut state.borrow_mut()))
    }
}
