//! The servers behind one client-side port: which of them a request is for, by which of the port's connections it is served, and
//! which one is connected next. Pure, with time as a value.
//!
//! A port has a few *connections*, each of which has a connection to one server at a time, or none. A free connection takes the server of
//! the request whose turn it is, or else one that could not be reached and is to be tried again. A port with one server is the
//! case of one connection; a serial line is a server that is always reached by it.

use embassy_time::{Duration, Instant};
use heapless::Vec;

use crate::settings::{PORT_SERVERS_MAX, SOCKETS_MAX, Tag, UnitRange};

/// First and longest pause before a server is tried again.
pub const RETRY_FIRST: Duration = Duration::from_millis(500);
/// See [`RETRY_FIRST`].
pub const RETRY_LONGEST: Duration = Duration::from_secs(10);
/// Failures after which pauses are not longer any more.
const FAILURES_MAX: u8 = 5;
/// Connections that a port can have at a time.
pub const CONNECTIONS_MAX: usize = SOCKETS_MAX;

const _: () = assert!(PORT_SERVERS_MAX <= u64::BITS as usize, "the size of Set");

/// Some of a port's servers, by their numbers.
pub type Set = u64;

/// Whether requests for a server are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Path {
    /// They are: it is connected, or will be when there is one.
    Open,
    /// Only of those who spare servers by themselves: what they wait for is the next attempt.
    Paused,
    /// None: it is being tried again.
    Tried,
}

/// One server.
struct Server {
    units: UnitRange,
    tag: Tag,
    path: Path,
    /// The connection that is connected to it, or tries to be.
    connection: Option<u8>,
    /// How often in a row it could not be reached, as far as that makes pauses longer.
    failures: u8,
    /// The end of the last pause, in milliseconds of the clock: a port may have many of these.
    retry_ms: u32,
}

impl Server {
    /// The end of the last pause, which is at most [`RETRY_LONGEST`] away.
    fn retry_at(&self, now: Instant) -> Instant {
        let ms = self.retry_ms.wrapping_sub(milliseconds(now)).cast_signed();
        if ms <= 0 { now } else { Instant::from_millis(now.as_millis() + u64::from(ms.unsigned_abs())) }
    }

    /// Leaves the server alone for `pause`, to its last millisecond.
    fn pause(&mut self, now: Instant, pause: Duration) {
        (self.path, self.retry_ms) = (Path::Paused, milliseconds(now + pause + Duration::from_micros(999)));
    }
}

/// The milliseconds of the clock, cut off.
fn milliseconds(now: Instant) -> u32 {
    now.as_millis() as u32
}

/// What a free connection does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// It connects to this server.
    Connect(usize),
    /// Nothing before this time, unless a request comes.
    Wait(Instant),
}

/// The servers of one port.
pub struct Servers(Vec<Server, PORT_SERVERS_MAX, u8>);

impl Servers {
    /// Those that are asked for these units, each under ids that the tag makes of them.
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

    /// A serial line: one server for all units, which the first connection has.
    pub fn line() -> Self {
        let mut line = Self::one();
        line.update(0, |server| server.connection = Some(0));
        line
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The server that is asked for `unit`.
    pub fn of(&self, unit: u8) -> Option<usize> {
        self.0.iter().position(|server| server.units.contains(unit))
    }

    /// What `unit` is called by its server.
    pub fn outside(&self, unit: u8) -> Option<u8> {
        self.get(self.of(unit)?)?.tag.apply(unit)
    }

    /// The unit that `server` calls `outside`, if it is asked for such a one.
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

    /// Whether a request for `unit` is taken, by somebody who is `sparing` servers by himself or not.
    pub fn takes(&self, unit: u8, sparing: bool) -> bool {
        self.of(unit).and_then(|server| self.get(server)).is_some_and(|server| match server.path {
            Path::Open => true,
            Path::Paused => sparing,
            Path::Tried => false,
        })
    }

    /// The connection that is connected to the server of `unit`, or tries to be.
    pub fn connection(&self, unit: u8) -> Option<u8> {
        self.get(self.of(unit)?)?.connection
    }

    /// The server of `unit` if no connection has it.
    pub fn unconnected(&self, unit: u8) -> Option<usize> {
        let server = self.of(unit)?;
        self.get(server)?.connection.is_none().then_some(server)
    }

    /// How many servers have a connection.
    pub fn connected_count(&self) -> usize {
        self.0.iter().filter(|server| server.connection.is_some()).count()
    }

    /// The servers without a connection that are to be tried again at `now`, and when there is the next one.
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

    /// What the free `connection` does at `now`. The request whose turn it is, of those whose servers no connection has, is for the server
    /// `wanted`; `keeps`: connections are opened before there is a request.
    pub fn choose(&mut self, connection: u8, wanted: Option<usize>, keeps: bool, now: Instant) -> Choice {
        let free = || self.0.iter().enumerate().filter(|(_, server)| server.connection.is_none());
        let is_due = |server: &Server| server.path != Path::Open && server.retry_at(now) <= now;
        let due = || free().filter(|(_, server)| is_due(server)).min_by_key(|(_, server)| server.retry_ms);
        let kept = || free().find(|(_, server)| keeps && server.path == Path::Open);
        let chosen = wanted.or_else(|| due().or_else(kept).map(|(number, _)| number));
        let Some(number) = chosen else { return Choice::Wait(self.retries(now).1) };
        if let Some(server) = self.0.get_mut(number) {
            server.connection = Some(connection);
            if server.path == Path::Paused {
                server.path = Path::Tried;
            }
        }
        Choice::Connect(number)
    }

    /// `server` is connected.
    pub fn opened(&mut self, server: usize) {
        self.update(server, |server| server.path = Path::Open);
    }

    /// What was asked of `server` has gone well.
    pub fn well(&mut self, server: usize) {
        self.update(server, |server| {
            (server.path, server.failures) = (Path::Open, 0);
        });
    }

    /// `server` cannot be reached, or gives no responses: it is left alone for a while, each time for longer.
    pub fn failed(&mut self, server: usize, now: Instant) {
        self.update(server, |server| {
            let pause = (RETRY_FIRST * (1 << server.failures)).min(RETRY_LONGEST);
            server.pause(now, pause);
            server.failures = (server.failures + 1).min(FAILURES_MAX);
        });
    }

    /// The attempt to reach `server` was given up at `now` because its connection was needed elsewhere: that says nothing about it.
    pub fn put_off(&mut self, server: usize, now: Instant) {
        self.update(server, |server| {
            if server.path != Path::Open {
                server.pause(now, RETRY_FIRST);
            }
        });
    }

    /// No connection has `server` any more.
    pub fn release(&mut self, server: usize) {
        self.update(server, |server| server.connection = None);
    }

    /// No server takes requests any more, but from those who spare them by themselves.
    pub fn close(&mut self) {
        self.0.iter_mut().for_each(|server| server.path = Path::Tried);
    }

    /// All servers take requests.
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
