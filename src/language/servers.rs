//! The servers of a `tcp client` port without an address: `server plant unit 1-5 at 192.168.1.20:502`.
//!
//! A port with an address in its own line has that one server, for all units.

use core::fmt::{self, Display};

use super::changed::Changed;
use super::option::option;
use super::port_values::server_address;
use super::problem::Problem;
use super::route_words;
#[cfg(feature = "web")] // As what uses it.
use super::shape::Shape;
use super::words::{Word, Words, Wrong};
use crate::settings::{
    MODBUS_TCP_PORT, PORT_SERVERS_MAX, PortId, PortKind, SERVERS_MAX, ServerSettings, Settings, Tag,
    UnitRange,
};

/// Calls `each` with the keywords that only these lines use.
pub(crate) fn keywords(each: &mut dyn FnMut(&'static str)) {
    ["at", "tag"].into_iter().for_each(each);
}

/// Calls `each` with the keywords of the line and their types.
// Only the web interface has settings by name.
#[cfg(feature = "web")]
pub(crate) fn members(each: &mut dyn FnMut(&'static str, Shape)) {
    each("unit", Shape::Text);
    keywords(&mut |keyword| each(keyword, Shape::Text));
}

/// The port that `word` names, if it is a TCP client without an address.
fn port(settings: &Settings, word: Word) -> Result<PortId, Wrong> {
    let id = route_words::port(settings, word)?;
    match settings.port(id).map(|port| &port.kind) {
        Some(PortKind::TcpClient(client)) if client.has_lines() => Ok(id),
        _ => Err(word.error(Problem::NotManyServers)),
    }
}

/// `unit 1-5`
fn units<'w>(words: &'w Words) -> Result<(Word<'w>, UnitRange), Wrong> {
    words.take().keyword(&[("unit", ())], "unit and the units of the server, such as 7 or 1-5")?;
    let word = words.take();
    Ok((word, route_words::units(word)?))
}

/// Parses a server up to the end of the line, and stores it.
pub(crate) fn server(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
    let port_word = words.take();
    let port = port(settings, port_word)?;
    let (units_word, units) = units(words)?;
    words.take().keyword(&[("at", ())], "at and the server's address")?;
    let at = server_address(words.take(), MODBUS_TCP_PORT)?;
    let mut tag = Tag::Keep;
    if !words.peek().is_end() {
        words.take().keyword(&[("tag", ())], "tag or the end of the line")?;
        let word = words.take();
        tag = route_words::tag(word, units)?;
        // Otherwise several units would become one, or one unit a broadcast.
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

/// Deletes the server with these units.
pub(crate) fn delete_server(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
    let id = port(settings, words.take())?;
    let (word, units) = units(words)?;
    words.end()?;
    let index = settings.servers.iter().position(|server| server.port == id && server.units == units);
    let index = index.ok_or_else(|| word.error(Problem::NoSuchServer))?;
    settings.servers.remove(index);
    Ok(Changed::Port(id))
}

/// The words after the port's name.
impl Display for ServerSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unit {:7} at {}", self.units, self.at)?;
        option(f, "tag", &self.tag, self.tag != Tag::Keep)
    }
}
