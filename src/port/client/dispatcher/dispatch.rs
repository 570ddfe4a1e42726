//! Which of the port's links serves whom: a free one takes the server of the order whose turn it is, and where all are taken
//! the one that is needed least is asked to go.

use embassy_futures::select::select;
use embassy_time::Instant;

use crate::frame::Frame;
use crate::gateway::Status;
use crate::gateway::socket::{self, Need};
use crate::gateway::unit_health::Ready;
use crate::port::client::dispatcher::Desk;
use crate::port::client::servers::{Choice, LINKS_MAX, Set};
use crate::port::timer::until;
use crate::settings::{SERVERS, ServerAddress, Settings};

impl<'g> Desk<'g> {
    /// Links that are in use.
    pub(crate) fn links(&self) -> u8 {
        self.links
    }

    /// Waits until [`Desk::next`], or [`Desk::chosen`], may have something new to say to `link`.
    pub(crate) async fn changed(&self, link: u8) {
        match self.news.get(usize::from(link)) {
            Some(news) => news.wait().await,
            None => core::future::pending().await,
        }
    }

    /// Tells who may serve `unit` that something has changed: the link that has its server, or else all.
    pub(super) fn tell(&self, unit: u8) {
        let link = if self.has_one_link() { Some(0) } else { self.servers().link(unit) };
        match link.and_then(|link| self.news.get(usize::from(link))) {
            Some(news) => news.signal(()),
            None => self.news.iter().for_each(|news| news.signal(())),
        }
    }

    /// Whether the first link is the only one.
    pub(super) fn has_one_link(&self) -> bool {
        LINKS_MAX == 1 || self.links == 1
    }

    /// The server that `link`, which is free, connects to next; `keeps`: connections are opened before there is an order.
    pub(crate) async fn chosen(&self, link: u8, keeps: bool) -> usize {
        loop {
            let now = Instant::now();
            let (wanted, later) = self.first_unlinked(now);
            let choice = self.servers().choose(link, wanted, keeps, now);
            match choice {
                Choice::Connect(server) => return server,
                Choice::Wait(at) => select(self.changed(link), until(at.min(later))).await,
            };
        }
    }

    /// The server of the order whose turn it is, of those whose servers no link has; or when there may be one.
    fn first_unlinked(&self, now: Instant) -> (Option<usize>, Instant) {
        if LINKS_MAX == 1 {
            // There is one server.
            return (self.is_wanted(0).then_some(0), Instant::MAX);
        }
        let lost = self.current().iter().find_map(|order| self.servers().unlinked(order.target()));
        if lost.is_some() {
            return (lost, Instant::MAX);
        }
        self.sweep_if_due(now);
        let ready = self.readiness(now);
        let is_unlinked = |unit| self.servers().unlinked(unit).is_some();
        let first =
            self.queue().first(now, |unit| if is_unlinked(unit) { ready(unit) } else { Ready::Elsewhere });
        match first {
            Ok(unit) => (self.servers().unlinked(unit), Instant::MAX),
            Err(later) => (None, later),
        }
    }

    /// Where servers wait for links and all are taken, asks for as many; gives the time from which on others may.
    pub(crate) fn make_room(&self) -> Instant {
        // Where each server may have a link of its own none is ever short.
        if LINKS_MAX == 1 || usize::from(self.links) >= self.servers().len() {
            return Instant::MAX;
        }
        let now = Instant::now();
        let (retries, mut later) = self.servers().retries(now);
        let ready = self.readiness(now);
        let mut wanted: Set = 0;
        for unit in self.queue().units() {
            let Some(server) = self.servers().unlinked(unit) else { continue };
            match ready(unit) {
                Ready::At(at) if at > now => later = later.min(at),
                _ => wanted |= 1 << server,
            }
        }
        let sockets = self.place().place().sockets.get(..usize::from(self.links)).unwrap_or(&[]);
        let leaving = sockets.iter().filter(|socket| socket.is_leaving()).count();
        let free = usize::from(self.links).saturating_sub(self.servers().linked()) + leaving;
        let (orders, all) = (wanted.count_ones() as usize, (wanted | retries).count_ones() as usize);
        for nth in free..all {
            let need = if nth < orders { Need::Order } else { Need::Retry };
            if !socket::ask_for_one(sockets, need, None) {
                break;
            }
        }
        later
    }

    /// Whether an order for `server` waits, or is to be sent again.
    pub(crate) fn is_wanted(&self, server: usize) -> bool {
        let is_its = |unit| self.is_of(server, unit);
        self.queue().units().any(is_its) || self.current().iter().any(|order| is_its(order.target()))
    }

    /// Whether `unit` is one of `server`.
    pub(crate) fn is_of(&self, server: usize, unit: u8) -> bool {
        LINKS_MAX == 1 || self.servers().of(unit) == Some(server)
    }

    /// What `unit` is called by its server.
    pub(crate) fn outside(&self, unit: u8) -> u8 {
        if LINKS_MAX == 1 { unit } else { self.servers().outside(unit).unwrap_or(unit) }
    }

    /// The unit that `server` calls `outside`, if it is asked for such a one.
    pub(crate) fn inside(&self, server: usize, outside: u8) -> Option<u8> {
        if LINKS_MAX == 1 { Some(outside) } else { self.servers().inside(server, outside) }
    }

    /// `server` is connected: its orders are queued.
    pub(crate) fn opened(&self, server: usize) {
        self.servers().opened(server);
    }

    /// The link of `server` has done with it, and all was well.
    pub(crate) fn left(&self, server: usize) {
        let mut servers = self.servers();
        servers.well(server);
        servers.release(server);
    }

    /// The link of `server` is needed elsewhere before it is connected.
    pub(crate) fn put_off(&self, server: usize) {
        let mut servers = self.servers();
        servers.put_off(server, Instant::now());
        servers.release(server);
    }

    /// `server` cannot be reached, or says nothing: what was on the wire is answered 0Bh, what waits or comes 0Ah.
    pub(crate) fn failed_to_reach(&self, server: usize) {
        self.servers().failed(server, Instant::now());
        self.close_orders(Some(server));
        self.servers().release(server);
    }

    /// Where `server` is.
    pub(crate) fn address(&self, server: usize) -> Option<ServerAddress> {
        self.gateway.settings(|settings| settings.address(self.id, server).cloned())
    }

    /// Notes how all servers are doing.
    pub(crate) fn set_all_statuses(&self, status: Status) {
        let count = if SERVERS { self.servers().len().max(1) } else { 1 };
        for server in 0..count {
            self.set_status(server, status);
        }
    }

    /// Notes how `server` is doing, and so the port; gives what was known before.
    pub(crate) fn set_status(&self, server: usize, status: Status) -> Status {
        let mut best = status;
        let of_line = |settings: &Settings| {
            let lines = || settings.servers_of(self.id).map(|(place, _)| place);
            let before = self.gateway.server_status(lines().nth(server)?, Some(status));
            let all = lines().filter_map(|place| self.gateway.server_status(place, None));
            best = all.min_by_key(|status| status.rank()).unwrap_or(status);
            before
        };
        let before = if SERVERS { self.gateway.settings(of_line) } else { None };
        let of_port = self.place().replace_status(best);
        before.unwrap_or(of_port)
    }

    /// One of the orders for `server` that are being carried out, if there is one that `is_lost`.
    pub(crate) fn lost(&self, server: usize, is_lost: impl Fn(&Frame<'g>) -> bool) -> Option<Frame<'g>> {
        let current = self.current();
        let lost = current.iter().find(|order| self.is_of(server, order.target()) && is_lost(order));
        lost.map(Frame::share)
    }
}
