//! How the ports that make connections share the board's sockets, when there are more servers than sockets.
//!
//! A port that finds none left asks for one. The connection that has been quiet for longest is closed for it; when all
//! are busy, the one that was opened first takes no more requests and goes as soon as those that are open have ended. So all
//! servers get their turn, and a server that cannot be reached holds no socket while it backs off.

use core::cell::Cell;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

use crate::config::PortId;
use crate::gateway::PortPlace;

/// A port's share of the sockets: one connection, or none.
pub(crate) struct Socket {
    state: Mutex<CriticalSectionRawMutex, Cell<State>>,
    /// The connection must go, to make room for another port's.
    pub(crate) leave: Signal<CriticalSectionRawMutex, ()>,
    /// Another port has closed its connection for this one.
    pub(crate) freed: Signal<CriticalSectionRawMutex, ()>,
}

#[derive(Clone, Copy)]
struct State {
    open: bool,
    /// Requests are open on it.
    busy: bool,
    opened: Instant,
    /// Its last request.
    used: Instant,
    /// Who waits for it to be closed.
    wanted_by: Option<PortId>,
}

impl State {
    /// The lowest is the first to go.
    fn rank(&self) -> (bool, Instant) {
        (self.busy, if self.busy { self.opened } else { self.used })
    }
}

impl Socket {
    /// No connection.
    pub(crate) const fn new() -> Self {
        let state =
            State { open: false, busy: false, opened: Instant::MIN, used: Instant::MIN, wanted_by: None };
        Self { state: Mutex::new(Cell::new(state)), leave: Signal::new(), freed: Signal::new() }
    }

    /// The port has a connection now.
    pub(crate) fn opened(&self) {
        let now = Instant::now();
        self.leave.reset();
        self.set(State { open: true, busy: false, opened: now, used: now, wanted_by: None });
    }

    /// Whether requests are open on the connection from now on.
    pub(crate) fn busy(&self, busy: bool) {
        let state = self.state();
        if state.busy != busy {
            self.set(State { busy, used: Instant::now(), ..state });
        }
    }

    /// The port has no connection any more; wakes the port among `places` that waits for it.
    pub(crate) fn closed(&self, places: &[PortPlace]) {
        let state = self.state();
        self.set(State { open: false, busy: false, wanted_by: None, ..state });
        if let Some(place) = state.wanted_by.and_then(|id| places.get(id.index())) {
            place.socket.freed.signal(());
        }
    }

    fn state(&self) -> State {
        self.state.lock(Cell::get)
    }

    fn set(&self, state: State) {
        self.state.lock(|cell| cell.set(state));
    }
}

/// Asks one of the connections of `places` to go for the port `id`; says whether one will.
pub(crate) fn ask_for_one(places: &[PortPlace], id: PortId) -> bool {
    let mut first: Option<(&Socket, State)> = None;
    for place in places {
        let state = place.socket.state();
        if state.open
            && state.wanted_by.is_none()
            && first.is_none_or(|(_, other)| state.rank() < other.rank())
        {
            first = Some((&place.socket, state));
        }
    }
    let Some((socket, state)) = first else { return false };
    socket.set(State { wanted_by: Some(id), ..state });
    socket.leave.signal(());
    true
}
