//! The servers behind one client-side port: which one a request is for, which connection serves it, and which server is connected
//! next. Pure, with time as a value.
//!
//! A port has a few *connections*, each connected to one server at a time, or to none. A free connection takes the server of the
//! next request, or else one whose retry is due. A port with one server has one connection; a serial line is a server that is
//! always connected to it.

use embassy_time::{Duration, Instant};
use heapless::Vec;

use crate::settings::{PORT_SERVERS_MAX, SOCKETS_MAX, Tag, UnitRange};

/// First and longest pause before a server is tried again.
pub const RETRY_FIRST: Duration = Duration::from_millis(500);
/// See [`RETRY_FIRST`].
pub const RETRY_LONGEST: Duration = Duration::from_secs(10);
/// Number of failures after which the pause stops growing.
const FAILURES_MAX: u8 = 5;
/// Most simultaneous connections of a port.
pub const CONNECTIONS_MAX: usize = SOCKETS_MAX;

const _: () = assert!(PORT_SERVERS_MAX <= u64::BITS as usize, "the size of Set");

/// A set of a port's servers, by number.
pub type Set = u64;

/// Whether requests for a server are accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Path {
    /// Yes: it is connected, or will be when there is a request.
    Open,
    /// Only from requesters with their own back-off; such a request triggers the next attempt, or waits for the one under way.
    Paused,
    /// No.
    Closed,
}

struct Server {
    units: UnitRange,
    tag: Tag,
    path: Path,
    /// The connection that is connected to it, or connecting.
    connection: Option<u8>,
    /// Failed attempts in a row, up to the limit of the pause.
    failures: u8,
    /// The end of the last pause in milliseconds of the clock, truncated: a port may have many servers.
    retry_ms: u32,
}

impl Server {
    /// The end of the last pause, which is at most [`RETRY_LONGEST`] away.
    fn retry_at(&self, now: Instant) -> Instant {
        let ms = self.retry_ms.wrapping_sub(milliseconds(now)).cast_signed();
        if ms <= 0 { now } else { Instant::from_millis(now.as_millis() + u64::from(ms.unsigned_abs())) }
    }

    /// No attempts for `pause`, rounded up to a whole millisecond.
    fn pause(&mut self, now: Instant, pause: Duration) {
        (self.path, self.retry_ms) = (Path::Paused, milliseconds(now + pause + Duration::from_micros(999)));
    }
}

/// The low bits of the clock's milliseconds.
fn milliseconds(now: Instant) -> u32 {
    now.as_millis() as u32
}

/// The next step of a free connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// Connect to this server.
    Connect(usize),
    /// Wait until this time, or until a request arrives.
    Wait(Instant),
}

/// The servers of one port.
pub struct Servers(Vec<Server, PORT_SERVERS_MAX, u8>);

impl Servers {
    /// Servers for these units, whose ids are translated by each server's tag.
    pub fn new(servers: impl IntoIterator<Item = (UnitRange, Tag)>) -> Self {
        let server = |(units, tag)| Server {
            units,
            tag,
            path: Path::Open,
            connection: None,
            failures: 0,
            retry_ms: 0,
        };
        Self(servers.into_iter().take(PORT_SERVERS_MAX).map(server).collect())
    }

    /// One server for all units.
    pub fn one() -> Self {
        Self::new([(UnitRange::ALL, Tag::Keep)])
    }

    /// A serial line: one server for all units, always on the first connection.
    pub fn line() -> Self {
        let mut line = Self::one();
        line.update(0, |server| server.connection = Some(0));
        line
    }

    /// Number of servers.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no servers.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The server of `unit`.
    pub fn of(&self, unit: u8) -> Option<usize> {
        self.0.iter().position(|server| server.units.contains(unit))
    }

    /// The server's own id for `unit`.
    pub fn outside(&self, unit: u8) -> Option<u8> {
        self.get(self.of(unit)?)?.tag.apply(unit)
    }

    /// The unit that `server` knows as `outside`, if any.
    pub fn inside(&self, server: usize, outside: u8) -> Option<u8> {
        let Server { units, tag, .. } = self.get(server)?;
        let unit = match *tag {
            Tag::Keep => outside,
            Tag::Add(by) => outside.checked_sub(by)?,
            Tag::Subtract(by) => outside.checked_add(by)?,
            Tag::Set(unit) if unit == outside => units.first,
            Tag::Set(_) => return None,
        };
        units.contains(unit).then_some(unit)
    }

    /// Whether a request for `unit` is accepted; `sparing`: its requester has its own back-off.
    pub fn takes(&self, unit: u8, sparing: bool) -> bool {
        self.of(unit).and_then(|server| self.get(server)).is_some_and(|server| match server.path {
            Path::Open => true,
            Path::Paused => sparing,
            Path::Closed => false,
        })
    }

    /// The connection that is connected, or connecting, to the server of `unit`.
    pub fn connection(&self, unit: u8) -> Option<u8> {
        self.get(self.of(unit)?)?.connection
    }

    /// The server of `unit`, if it has no connection.
    pub fn unconnected(&self, unit: u8) -> Option<usize> {
        let server = self.of(unit)?;
        self.get(server)?.connection.is_none().then_some(server)
    }

    /// Number of servers with a connection.
    pub fn connected_count(&self) -> usize {
        self.0.iter().filter(|server| server.connection.is_some()).count()
    }

    /// The servers without a connection whose retry is due at `now`, and when the next one is due.
    pub fn retries(&self, now: Instant) -> (Set, Instant) {
        let mut retries = (0, Instant::MAX);
        for (nth, server) in self.0.iter().enumerate() {
            if server.path != Path::Open && server.connection.is_none() {
                match server.retry_at(now) {
                    at if at <= now => retries.0 |= 1 << nth,
                    at => retries.1 = retries.1.min(at),
                }
            }
        }
        retries
    }

    /// The next step of the free `connection` at `now`. `wanted`: the server of the next request whose server has no connection;
    /// `keeps`: connections are opened before there is a request.
    pub fn choose(&mut self, connection: u8, wanted: Option<usize>, keeps: bool, now: Instant) -> Choice {
        let free = || self.0.iter().enumerate().filter(|(_, server)| server.connection.is_none());
        let is_due = |server: &Server| server.path != Path::Open && server.retry_at(now) <= now;
        let due = || free().filter(|(_, server)| is_due(server)).min_by_key(|(_, server)| server.retry_ms);
        let kept = || free().find(|(_, server)| keeps && server.path == Path::Open);
        let chosen = wanted.or_else(|| due().or_else(kept).map(|(number, _)| number));
        let Some(number) = chosen else { return Choice::Wait(self.retries(now).1) };
        if let Some(server) = self.0.get_mut(number) {
            server.connection = Some(connection);
        }
        Choice::Connect(number)
    }

    /// Records that `server` is connected.
    pub fn opened(&mut self, server: usize) {
        self.update(server, |server| server.path = Path::Open);
    }

    /// Records that `server` responded.
    pub fn well(&mut self, server: usize) {
        self.update(server, |server| {
            (server.path, server.failures) = (Path::Open, 0);
        });
    }

    /// Records that `server` is unreachable or does not respond: the next attempt follows a pause that grows each time.
    pub fn failed(&mut self, server: usize, now: Instant) {
        self.update(server, |server| {
            let pause = (RETRY_FIRST * (1 << server.failures)).min(RETRY_LONGEST);
            server.pause(now, pause);
            server.failures = (server.failures + 1).min(FAILURES_MAX);
        });
    }

    /// Records that the attempt to reach `server` was cancelled because its socket was needed elsewhere, which says nothing about
    /// the server.
    pub fn put_off(&mut self, server: usize, now: Instant) {
        self.update(server, |server| {
            if server.path != Path::Open {
                server.pause(now, RETRY_FIRST);
            }
        });
    }

    /// Records that `server` has no connection any more.
    pub fn release(&mut self, server: usize) {
        self.update(server, |server| server.connection = None);
    }

    /// Refuses requests for all servers.
    pub fn close(&mut self) {
        self.0.iter_mut().for_each(|server| server.path = Path::Closed);
    }

    /// Accepts requests for all servers.
    pub fn open(&mut self) {
        self.0.iter_mut().for_each(|server| server.path = Path::Open);
    }

    fn get(&self, server: usize) -> Option<&Server> {
        self.0.get(server)
    }

    fn update(&mut self, server: usize, change: impl FnOnce(&mut Server)) {
        if let Some(server) = self.0.get_mut(server) {
            change(server);
        }
    }
}
