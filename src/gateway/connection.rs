//! What the tasks share of a TCP connection: who sits there, and what is to become of it.

use core::cell::RefCell;
use core::net::SocketAddr;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

use super::shared::Shared;
use crate::frame::Channel;
use crate::settings::PortId;

/// What the tasks share of one place for a TCP connection.
pub struct Connection {
    /// Answers for the connection; only the router sends, only the connection receives.
    pub(crate) responses: Channel,
    /// The connection was given to another port, or its port has changed.
    pub(crate) changed: Signal<CriticalSectionRawMutex, ()>,
    /// The connection must go, to make room for another one.
    pub(crate) leave: Signal<CriticalSectionRawMutex, ()>,
    state: Shared<ConnectionState>,
}

/// Who sits in a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConnectionState {
    /// The TCP server that the connection belongs to.
    pub port: Option<PortId>,
    /// The connected client.
    pub peer: Option<SocketAddr>,
    /// Whether the client may use reserved places.
    pub marked: bool,
    /// Whether the connection was told to leave.
    pub leaving: bool,
    /// Counts the connections of this connection.
    pub generation: u16,
    /// When the client came.
    pub since: Instant,
    /// When its last request came, or a part of one, or the client itself.
    pub last_request: Instant,
    /// Requests that are not answered yet.
    pub open_requests: u8,
    /// Requests of this connection.
    pub requests: u32,
}

impl ConnectionState {
    pub(crate) const EMPTY: Self = Self {
        port: None,
        peer: None,
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
    /// An empty connection.
    pub const fn new() -> Self {
        Self {
            responses: Channel::new(),
            changed: Signal::new(),
            leave: Signal::new(),
            state: Mutex::new(RefCell::new(ConnectionState::EMPTY)),
        }
    }

    /// The connection is for connections to `port` from now on, or for none.
    pub(super) fn assign(&self, port: Option<PortId>) {
        self.update(|connection| connection.port = port);
        self.changed.signal(());
    }

    /// Who sits here.
    pub fn state(&self) -> ConnectionState {
        self.update(|state| *state)
    }

    /// Calls `change` with who sits here, to look at or to change.
    pub(crate) fn update<R>(&self, change: impl FnOnce(&mut ConnectionState) -> R) -> R {
        self.state.lock(|state| change(&mut state.borrow_mut()))
    }
}

impl Default for Connection {
    fn default() -> Self {
        Self::new()
    }
}
