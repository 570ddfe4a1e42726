//! Assigns the port's connections to servers: a free connection takes the server of the next request, and when all are taken the
//! least needed is closed.

use core::cell::Cell;
use core::future::poll_fn;
use core::task::Poll;

use embassy_futures::select::select;
use embassy_time::Instant;

use crate::frame::Frame;
use crate::gateway::Status;
use crate::gateway::socket::{self, Need};
use crate::gateway::unit_health::Ready;
use crate::port::client::dispatcher::Dispatcher;
use crate::port::client::servers::{CONNECTIONS_MAX, Choice, Set};
use crate::port::timer::until;
use crate::settings::{SERVERS, ServerAddress, Settings};

impl<'g> Dispatcher<'g> {
    /// Connections in use.
    pub(crate) fn connections(&self) -> u8 {
        self.connections
    }

    /// Waits until [`Dispatcher::next`] or [`Dispatcher::chosen`] may return something new for `connection`.
    pub(crate) fn changed(&self, connection: u8) -> impl Future<Output = ()> {
        poll_fn(move |context| {
            if self.changed.get(usize::from(connection)).is_some_and(Cell::take) {
                return Poll::Ready(());
            }
            if CONNECTIONS_MAX > 1 {
                self.task.borrow_mut().register(context.waker());
            }
            Poll::Pending
        })
    }

    /// Tells the connection that has the server of `unit`, or all connections if none has it. They are polled next, so the task,
    /// which is the caller's own, is not woken for them.
    pub(super) fn notify(&self, unit: u8) {
        let connection = if self.has_one_connection() { Some(0) } else { self.servers().connection(unit) };
        match connection.and_then(|connection| self.changed.get(usize::from(connection))) {
            Some(changed) => changed.set(true),
            None => self.changed.iter().for_each(|changed| changed.set(true)),
        }
    }

    /// Whether the first connection is the only one.
    pub(super) fn has_one_connection(&self) -> bool {
        CONNECTIONS_MAX == 1 || self.connections == 1
    }

    /// The server for the free `connection`; with `keeps`, connections are opened before there is a request.
    pub(crate) async fn chosen(&self, connection: u8, keeps: bool) -> usize {
        loop {
            let now = Instant::now();
            let (wanted, later) = self.first_unconnected(now);
            let choice = self.servers().choose(connection, wanted, keeps, now);
            match choice {
                Choice::Connect(server) => return server,
                Choice::Wait(at) => select(self.changed(connection), until(at.min(later))).await,
            };
        }
    }

    /// The server of the next request whose server has no connection; otherwise when to check again.
    fn first_unconnected(&self, now: Instant) -> (Option<usize>, Instant) {
        if CONNECTIONS_MAX == 1 {
            // There is only one server.
            return (self.is_wanted(0).then_some(0), Instant::MAX);
        }
        let lost = self.current().iter().find_map(|request| self.servers().unconnected(request.target()));
        if lost.is_some() {
            return (lost, Instant::MAX);
        }
        self.sweep_if_due(now);
        let ready = self.readiness(now);
        let is_unlinked = |unit| self.servers().unconnected(unit).is_some();
        let first =
            self.queue().first(now, |unit| if is_unlinked(unit) { ready(unit) } else { Ready::Elsewhere });
        match first {
            Ok(unit) => (self.servers().unconnected(unit), Instant::MAX),
            Err(later) => (None, later),
        }
    }

    /// If servers wait for connections and all are taken, asks connections to close; returns when to check again.
    pub(crate) fn make_room(&self) -> Instant {
        // With a connection for every server there is no shortage.
        if CONNECTIONS_MAX == 1 || usize::from(self.connections) >= self.servers().len() {
            return Instant::MAX;
        }
        let now = Instant::now();
        let (retries, mut later) = self.servers().retries(now);
        let ready = self.readiness(now);
        let mut wanted: Set = 0;
        for unit in self.queue().units() {
            let Some(server) = self.servers().unconnected(unit) else { continue };
            match ready(unit) {
                Ready::At(at) if at > now => later = later.min(at),
                _ => wanted |= 1 << server,
            }
        }
        let sockets = self.port_state().state().sockets.get(..usize::from(self.connections)).unwrap_or(&[]);
        let leaving = sockets.iter().filter(|socket| socket.is_leaving()).count();
        let free = usize::from(self.connections).saturating_sub(self.servers().connected_count()) + leaving;
        let (requests, all) = (wanted.count_ones() as usize, (wanted | retries).count_ones() as usize);
        for nth in free..all {
            let need = if nth < requests { Need::Request } else { Need::Retry };
            if !socket::ask_for_one(sockets, need, None) {
                break;
            }
        }
        later
    }

    /// Whether a request for `server` is waiting or to be repeated.
    pub(crate) fn is_wanted(&self, server: usize) -> bool {
        let is_its = |unit| self.is_of(server, unit);
        self.queue().units().any(is_its) || self.current().iter().any(|request| is_its(request.target()))
    }

    /// Whether `unit` belongs to `server`.
    pub(crate) fn is_of(&self, server: usize, unit: u8) -> bool {
        CONNECTIONS_MAX == 1 || self.servers().of(unit) == Some(server)
    }

    /// The server's own id for `unit`.
    pub(crate) fn outside(&self, unit: u8) -> u8 {
        if CONNECTIONS_MAX == 1 { unit } else { self.servers().outside(unit).unwrap_or(unit) }
    }

    /// The unit that `server` knows as `outside`, if any.
    pub(crate) fn inside(&self, server: usize, outside: u8) -> Option<u8> {
        if CONNECTIONS_MAX == 1 { Some(outside) } else { self.servers().inside(server, outside) }
    }

    /// Records that `server` is connected: its requests are queued.
    pub(crate) fn opened(&self, server: usize) {
        self.servers().opened(server);
    }

    /// Records that the connection of `server` ended normally.
    pub(crate) fn disconnected(&self, server: usize) {
        let mut servers = self.servers();
        servers.well(server);
        servers.release(server);
    }

    /// Records that the socket for `server` was needed elsewhere before it connected.
    pub(crate) fn put_off(&self, server: usize) {
        let mut servers = self.servers();
        servers.put_off(server, Instant::now());
        servers.release(server);
    }

    /// Records that `server` is unreachable or silent: requests on the wire get 0Bh, waiting and new ones 0Ah.
    pub(crate) fn failed_to_reach(&self, server: usize) {
        self.servers().failed(server, Instant::now());
        self.close_requests(Some(server));
        self.servers().release(server);
    }

    /// The address of `server`.
    pub(crate) fn address(&self, server: usize) -> Option<ServerAddress> {
        self.gateway.settings(|settings| settings.address(self.id, server).cloned())
    }

    /// Sets the status of all servers.
    pub(crate) fn set_all_statuses(&self, status: Status) {
        let count = if SERVERS { self.servers().len().max(1) } else { 1 };
        for server in 0..count {
            self.set_status(server, status);
        }
    }

    /// Sets the status of `server`, and derives that of the port; returns the previous one.
    pub(crate) fn set_status(&self, server: usize, status: Status) -> Status {
        let mut best = status;
        let of_line = |settings: &Settings| {
            let lines = || settings.servers_of(self.id).map(|(port_state, _)| port_state);
            let before = self.gateway.server_status(lines().nth(server)?, Some(status));
            let all = lines().filter_map(|port_state| self.gateway.server_status(port_state, None));
            best = all.min_by_key(|status| status.rank()).unwrap_or(status);
            before
        };
        let before = if SERVERS { self.gateway.settings(of_line) } else { None };
        let of_port = self.port_state().replace_status(best);
        before.unwrap_or(of_port)
    }

    /// A request in flight for `server` for which `is_lost` holds.
    pub(crate) fn lost(&self, server: usize, is_lost: impl Fn(&Frame<'g>) -> bool) -> Option<Frame<'g>> {
        let current = self.current();
        let lost = current.iter().find(|request| self.is_of(server, request.target()) && is_lost(request));
        lost.map(Frame::share)
    }
}
