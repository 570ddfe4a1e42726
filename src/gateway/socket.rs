//! Shares sockets among connections to outside servers when there are more servers than sockets: within a port among its servers,
//! and on the board among all ports.
//!
//! A connection without a socket requests one. The connection that has been idle longest is closed for it; if none is idle, a retry
//! that no request waits for is abandoned; if all are busy, the one opened first takes no new requests and closes once its open
//! requests have ended. So all servers get their turn, and an unreachable server holds no socket while it backs off.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

use crate::settings::PortId;

/// One of a port's sockets, connected or not.
pub(crate) struct Socket {
    state: Mutex<CriticalSectionRawMutex, Cell<State>>,
    /// The connection must close, to make room for another.
    pub(crate) leave: Signal<CriticalSectionRawMutex, ()>,
    /// Another connection was closed for this one.
    pub(crate) freed: Signal<CriticalSectionRawMutex, ()>,
}

/// The present use of a socket. Of those that may be closed, the lowest is closed first.
// `None` is 0, so that the initial state is all zeros, which take no flash on a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Use {
    /// Nothing to close.
    None,
    /// No requests are open.
    Idle,
    /// Retries a server that no request waits for.
    Retry,
    /// Requests are open.
    Busy,
}

/// Why a socket is needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Need {
    /// A request is waiting.
    Request,
    /// A server's retry is due.
    Retry,
}

#[derive(Clone, Copy)]
struct State {
    used_for: Use,
    opened: Instant,
    /// When the last request began or ended.
    used: Instant,
    /// It has been asked to close.
    leaving: bool,
    /// The port and connection waiting for it.
    wanted_by: Option<(PortId, u8)>,
}

impl State {
    const NONE: Self = Self {
        used_for: Use::None,
        opened: Instant::MIN,
        used: Instant::MIN,
        leaving: false,
        wanted_by: None,
    };

    /// The lowest is closed first.
    fn rank(&self) -> (Use, Instant) {
        (self.used_for, if self.used_for == Use::Idle { self.used } else { self.opened })
    }

    fn may_be_closed_for(&self, need: Need) -> bool {
        let last = if need == Need::Request { Use::Busy } else { Use::Idle };
        !self.leaving && self.used_for != Use::None && self.used_for <= last
    }
}

impl Socket {
    /// An unconnected socket.
    pub(crate) const fn new() -> Self {
        Self { state: Mutex::new(Cell::new(State::NONE)), leave: Signal::new(), freed: Signal::new() }
    }

    /// Records that a connection is being opened; `retry`: not for a request.
    pub(crate) fn opening(&self, retry: bool) {
        self.leave.reset();
        let used_for = if retry { Use::Retry } else { Use::None };
        self.set(State { used_for, opened: Instant::now(), ..State::NONE });
    }

    /// Records that the connection is open.
    pub(crate) fn opened(&self) {
        let now = Instant::now();
        self.leave.reset();
        self.set(State { opened: now, used: now, ..State::NONE });
    }

    /// Sets whether requests are open on the connection; returns whether that has changed.
    pub(crate) fn busy(&self, busy: bool) -> bool {
        let state = self.state();
        let used_for = if busy { Use::Busy } else { Use::Idle };
        let has_changed = state.used_for != used_for;
        if has_changed {
            self.set(State { used_for, used: Instant::now(), ..state });
        }
        has_changed
    }

    /// Whether the connection has been asked to close.
    pub(crate) fn is_leaving(&self) -> bool {
        self.state().leaving
    }

    /// Records that the connection was closed; returns the port and connection waiting for the socket.
    pub(crate) fn closed(&self) -> Option<(PortId, u8)> {
        let wanted_by = self.state().wanted_by;
        self.set(State::NONE);
        wanted_by
    }

    fn state(&self) -> State {
        self.state.lock(Cell::get)
    }

    fn set(&self, state: State) {
        self.state.lock(|cell| cell.set(state));
    }
}

/// Asks one of `sockets` to close, on behalf of `wanted_by` if given; returns whether one will.
pub(crate) fn ask_for_one<'s>(
    sockets: impl IntoIterator<Item = &'s Socket>,
    need: Need,
    wanted_by: Option<(PortId, u8)>,
) -> bool {
    let mut first: Option<(&Socket, State)> = None;
    for socket in sockets {
        let state = socket.state();
        if state.may_be_closed_for(need) && first.is_none_or(|(_, other)| state.rank() < other.rank()) {
            first = Some((socket, state));
        }
    }
    let Some((socket, state)) = first else { return false };
    socket.set(State { leaving: true, wanted_by, ..state });
    socket.leave.signal(());
    true
}
