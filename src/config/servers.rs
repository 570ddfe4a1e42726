//! The servers behind a `tcp client` port that has several: `server plant unit 1-5 at 192.168.1.20:502`.
//!
//! A port with an address in its own line has that one server, for all units.

use core::fmt::{self, Display};
use core::net::{IpAddr, SocketAddr};

use heapless::String;

use super::address::Endpoint;
use super::port_values::server_address;
use super::print::option;
use super::problem::Problem;
use super::route_words;
use super::text::Changed;
use super::words::{Word, Words, Wrong};
use super::{PortId, PortKind, Settings};
use crate::route::{Tag, UnitRange};

/// Whether ports can have several servers, and servers names. Without the feature `servers` the code and memory for both is not
/// in an image.
pub(crate) const SERVERS: bool = cfg!(feature = "servers");
/// Server lines of all ports together.
pub const SERVERS_MAX: usize = match (SERVERS, cfg!(feature = "small")) {
    (false, _) => 0,
    (true, true) => 16,
    (true, false) => 128,
};
/// Servers of one port.
pub const PORT_SERVERS_MAX: usize = match (SERVERS, cfg!(feature = "small")) {
    (false, _) => 1,
    (true, true) => 8,
    (true, false) => 64,
};
/// Connections that one port can have at a time.
pub const SOCKETS_MAX: usize = match (SERVERS, cfg!(feature = "small")) {
    (false, _) => 1,
    (true, true) => 2,
    (true, false) => 16,
};
/// Longest name of a server in bytes: with the feature `small` shorter than a name may be.
pub const SERVER_NAME_BYTES_MAX: usize = if cfg!(feature = "small") { 31 } else { 63 };

/// A server's name, to be looked up.
pub type ServerName = String<SERVER_NAME_BYTES_MAX, u8>;

/// The machine that a server runs on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Host {
    /// By its address.
    Address(IpAddr),
    /// By its name, which is looked up whenever a connection is opened.
    Name(ServerName),
}

/// Where a server is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerAddress {
    /// The machine.
    pub host: Host,
    /// The TCP port number.
    pub port: u16,
}

impl From<SocketAddr> for ServerAddress {
    fn from(address: SocketAddr) -> Self {
        Self { host: Host::Address(address.ip()), port: address.port() }
    }
}

impl Display for ServerAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.host {
            Host::Address(address) => Endpoint(SocketAddr::new(*address, self.port)).fmt(f),
            Host::Name(name) => write!(f, "{name}:{}", self.port),
        }
    }
}

/// One of several servers behind a port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServerSettings {
    /// The port.
    pub port: PortId,
    /// The units that it is asked for, as rules call them on the port's side.
    pub units: UnitRange,
    /// Where it is.
    pub at: ServerAddress,
    /// What becomes of the unit id on the way to it.
    pub tag: Tag,
}

impl Settings {
    /// The servers of the port at `id` that have lines of their own, each with its place among all such lines.
    pub fn servers_of(&self, id: PortId) -> impl Iterator<Item = (usize, &ServerSettings)> + Clone {
        // Where there are none, neither is the code for them.
        let all: &[ServerSettings] = if SERVERS { &self.servers } else { &[] };
        all.iter().enumerate().filter(move |(_, server)| server.port == id)
    }

    /// Where the server `number` (from 0) of the TCP client at `id` is.
    pub(crate) fn address(&self, id: PortId, number: usize) -> Option<&ServerAddress> {
        let PortKind::TcpClient(client) = &self.port(id)?.kind else { return None };
        client.server.as_ref().or_else(|| Some(&self.servers_of(id).nth(number)?.1.at))
    }

    /// The server that is asked for `unit` by the TCP client at `id`, and what the unit is called there.
    pub(crate) fn server(&self, id: PortId, unit: u8) -> Option<(&ServerAddress, u8)> {
        let PortKind::TcpClient(client) = &self.port(id)?.kind else { return None };
        if let Some(server) = &client.server {
            return Some((server, client.unit.unwrap_or(unit)));
        }
        let (_, server) = self.servers_of(id).find(|(_, server)| server.units.contains(unit))?;
        Some((&server.at, server.tag.apply(unit)?))
    }
}

/// Gives `each` the words of these lines that no other line has.
pub(super) fn keywords(each: &mut dyn FnMut(&'static str)) {
    ["at", "tag"].into_iter().for_each(each);
}

/// The port that `word` names, if it is a TCP client without an address.
fn port(settings: &Settings, word: Word) -> Result<PortId, Wrong> {
    let id = route_words::port(settings, word)?;
    match settings.port(id).map(|port| &port.kind) {
        Some(PortKind::TcpClient(client)) if client.server.is_none() => Ok(id),
        _ => Err(word.error(Problem::NotManyServers)),
    }
}

/// `unit 1-5`
fn units<'w>(words: &'w Words) -> Result<(Word<'w>, UnitRange), Wrong> {
    words.take().keyword(&[("unit", ())], "unit and the units of the server, such as 7 or 1-5")?;
    let word = words.take();
    Ok((word, route_words::units(word)?))
}

/// Reads a server up to the end of the line, and puts it into the settings.
pub(super) fn server(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
    let port_word = words.take();
    let port = port(settings, port_word)?;
    let (units_word, units) = units(words)?;
    words.take().keyword(&[("at", ())], "at and the server's address")?;
    let at = server_address(words.take())?;
    let mut tag = Tag::Keep;
    if !words.peek().is_end() {
        words.take().keyword(&[("tag", ())], "tag or the end of the line")?;
        let word = words.take();
        tag = route_words::tag(word, units)?;
        // Two units would be one there, or one unit all.
        let one_by_one = units.first == units.last || !matches!(tag, Tag::Set(_));
        if tag != Tag::Keep && (units.first == 0 || !one_by_one) {
            return Err(word.expected("* or a shift for several units, and * for unit 0"));
        }
    }
    words.end()?;
    let overlaps =
        |other: &ServerSettings| other.units.first <= units.last && units.first <= other.units.last;
    if let Some((_, other)) = settings.servers_of(port).find(|(_, other)| overlaps(other)) {
        let unit = units.first.max(other.units.first);
        return Err(units_word.error(Problem::UnitTaken { unit, units: other.units }));
    }
    if settings.servers_of(port).count() >= PORT_SERVERS_MAX {
        return Err(port_word.error(Problem::ServersFull(PORT_SERVERS_MAX)));
    }
    let server = ServerSettings { port, units, at, tag };
    settings.servers.push(server).map_err(|_| port_word.error(Problem::ServersFull(SERVERS_MAX)))?;
    Ok(Changed::Port(port))
}

/// Takes the server with these units away.
pub(super) fn delete_server(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
    let id = port(settings, words.take())?;
    let (word, units) = units(words)?;
    words.end()?;
    let place = settings.servers.iter().position(|server| server.port == id && server.units == units);
    let place = place.ok_or_else(|| word.error(Problem::NoSuchServer))?;
    settings.servers.remove(place);
    Ok(Changed::Port(id))
}

/// The words behind the port's name.
impl Display for ServerSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unit {:7} at {}", self.units, self.at)?;
        option(f, "tag", self.tag, self.tag != Tag::Keep)
    }
}
