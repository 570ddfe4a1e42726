//! Executes the lines of settings, verb by verb.

use core::mem::discriminant;
use core::num::NonZeroU16;

// As what uses it.
#[cfg(feature = "tls")]
use super::certificates;
use super::changed::Changed;
use super::listed::listed;
use super::point_problem::PointProblem;
use super::port_keys::{Keys, UNIT_KEYS};
use super::port_kinds::{KEYS, MEDIA};
use super::port_words::Draft;
use super::problem::Problem;
use super::route_words::route;
use super::values::{name, number};
use super::words::{Word, Words, Wrong};
// As what uses it.
#[cfg(feature = "mqtt")]
use super::publish;
use super::{mdns, own_network, point_checks, point_words, route_words, servers, slaves, users};
use crate::scanner::POINTS;
use crate::settings::{
    Destination, Name, PORTS_MAX, Port, PortId, PortKind, ROUTES_MAX, Route, Rules, SERVERS, Settings, USERS,
};

/// Executes the words after a verb.
pub(crate) type Change = fn(&mut Settings, &Words<'_>) -> Result<Changed, Wrong>;

/// Replaces the function of a verb that the image lacks.
pub(crate) fn absent(_: &mut Settings, _: &Words<'_>) -> Result<Changed, Wrong> {
    Ok(Changed::Nothing)
}

/// `network ...`
pub(crate) fn network(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    settings.network = Some(own_network::own_network(words)?);
    Ok(Changed::Other)
}

/// `mdns ...`
pub(crate) fn mdns_line(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    settings.mdns = mdns::mdns(words)?;
    Ok(Changed::Other)
}

/// `route ...`: appends a rule.
pub(crate) fn add_route(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    put_route(settings, words, settings.routes.len(), false)
}

/// Calls `each` with all keywords of rows and ports.
pub(crate) fn option_words(each: &mut dyn FnMut(&'static str)) {
    MEDIA.iter().for_each(|(keyword, _)| each(keyword));
    let tables = || KEYS.iter().chain([&UNIT_KEYS]);
    for (nth, table) in tables().enumerate() {
        for &(keyword, _) in *table {
            // Several kinds have a `timeout`: it is offered once.
            let is_known = |earlier: &Keys| earlier.iter().any(|(known, _)| *known == keyword);
            if !tables().take(nth).any(is_known) {
                each(keyword);
            }
        }
    }
    route_words::keywords(each);
    if SERVERS {
        servers::keywords(each);
    }
    // Without points these lines are refused, so they offer no keywords.
    if POINTS {
        point_words::keywords(each);
        slaves::keywords(each);
    }
}

/// `port ...`
pub(crate) fn port(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    let name_word = words.take();
    let name = name(name_word)?;
    let is_kind = |word: Word| word.lookup(MEDIA).is_some();
    if is_kind(name_word) && !is_kind(words.peek()) {
        return Err(
            name_word.error(Problem::TakenAs("the port's name, which comes first: port NAME KIND ..."))
        );
    }
    let draft = Draft::create(words)?;
    // Not `find`, which also accepts a bare number for a name.
    let same = |port: &Option<Port>| port.as_ref().is_some_and(|port| port.name.eq_ignore_ascii_case(&name));
    let place = settings
        .ports
        .iter()
        .position(same)
        .or_else(|| settings.ports.iter().position(Option::is_none))
        .ok_or_else(|| name_word.error(Problem::PortsFull))?;
    put_port(
        settings,
        PortId(place as u8),
        Port { name, kind: draft.kind, units: draft.units },
        name_word,
        draft.endpoint,
    )
}

/// Why port kind `own` cannot coexist with the port `other`, called `name`.
fn conflict(own: &PortKind, other: &PortKind, name: &Name) -> Option<Problem> {
    match (own, other) {
        (PortKind::Serial(own), PortKind::Serial(other)) if own.device == other.device => {
            Some(Problem::DeviceTaken(name.clone()))
        }
        // As its kind of port.
        #[cfg(feature = "web")]
        (PortKind::Http(_), PortKind::Http(_)) => Some(Problem::HttpTaken),
        (PortKind::UdpServer(own), PortKind::UdpServer(other)) if own.listen.collides(&other.listen) => {
            Some(Problem::ListenTaken)
        }
        // As these devices.
        #[cfg(feature = "dial-in")]
        (PortKind::TcpClient(own), PortKind::TcpClient(other))
            if own.listens().is_some() && own.listens() == other.listens() =>
        {
            let (own, other) = (own.dial_in.as_ref()?, other.dial_in.as_ref()?);
            own.overlaps(other).then(|| Problem::DevicesTaken(name.clone()))
        }
        (PortKind::Ethercat(_), PortKind::Ethercat(_)) => Some(Problem::Points(PointProblem::EthercatTaken)),
        (PortKind::Scanner, PortKind::Scanner) => Some(Problem::Points(PointProblem::ScannerTaken)),
        _ => {
            let (own, other) = (own.tcp_listen()?, other.tcp_listen()?);
            own.collides(other).then_some(Problem::ListenTaken)
        }
    }
}

/// Checks `port` against all others and the rules, then stores it at `id`.
fn put_port(
    settings: &mut Settings,
    id: PortId,
    port: Port,
    name: Word,
    endpoint: Word,
) -> Result<Changed, Wrong> {
    let others = settings.ports.iter().enumerate().filter(|&(at, _)| at != id.index());
    for Port { name, kind: other, .. } in others.filter_map(|(_, other)| other.as_ref()) {
        if let Some(problem) = conflict(&port.kind, other, name) {
            return Err(endpoint.error(problem));
        }
    }
    let has_lines = matches!(&port.kind, PortKind::TcpClient(client) if client.has_lines());
    if !has_lines {
        check_no_servers(settings, id, name)?;
    }
    let changes = |old: &Port| discriminant(&old.kind) != discriminant(&port.kind);
    if settings.port(id).is_some_and(changes) {
        check_unused(settings, id, name)?;
    }
    // Left out of images without TLS.
    #[cfg(feature = "tls")]
    if let Some(problem) = certificates::lacks_certificate(settings, &port.kind) {
        return Err(name.error(problem));
    }
    #[cfg(feature = "tls")]
    if !port.kind.has_roles() {
        let by_role = settings.routes.iter().map(|route| route.source == id && !route.role.is_none());
        if let Some(rules) = Rules::of(by_role) {
            return Err(name.error(Problem::RulesNeedTls(rules)));
        }
    }
    if !port.kind.has_peers() {
        let by_address = settings.routes.iter().map(|route| route.source == id && route.peer.is_some());
        if let Some(rules) = Rules::of(by_address) {
            return Err(name.error(Problem::RulesNeedTcp(rules)));
        }
    }
    if let Some(slot) = settings.ports.get_mut(id.index()) {
        *slot = Some(port);
    }
    Ok(Changed::Port(id))
}

/// Fails if the port at `id` has server lines.
fn check_no_servers(settings: &Settings, id: PortId, word: Word) -> Result<(), Wrong> {
    match settings.servers_of(id).count() {
        0 => Ok(()),
        count => Err(word.error(Problem::ServersInUse(count))),
    }
}

/// Fails if there are devices or slaves that the port at `id` polls.
fn check_unused(settings: &Settings, id: PortId, word: Word) -> Result<(), Wrong> {
    match settings.port(id).map(|port| &port.kind) {
        Some(PortKind::Scanner) if !settings.devices.is_empty() => {
            Err(word.error(Problem::Points(PointProblem::ScannerInUse)))
        }
        Some(PortKind::Ethercat(_)) if !settings.slaves.is_empty() => {
            Err(word.error(Problem::Points(PointProblem::EthercatInUse)))
        }
        _ => Ok(()),
    }
}

/// Parses a rule and stores it at index `at`, in place of the rule there or before it.
fn put_route(settings: &mut Settings, words: &Words, at: usize, replace: bool) -> Result<Changed, Wrong> {
    let first = words.peek();
    let route = route(settings, words)?;
    if let Some(same) = settings.routes.iter().position(|other| *other == route)
        && !(replace && same == at)
    {
        let number = NonZeroU16::MIN.saturating_add(same as u16);
        return Err(first.error(Problem::SameRoute(number)));
    }
    match settings.routes.get_mut(at).filter(|_| replace) {
        Some(old) => *old = route,
        None => settings.routes.insert(at, route).map_err(|_| first.error(Problem::RoutesFull))?,
    }
    Ok(Changed::Rule(at))
}

#[derive(Clone, Copy)]
enum Thing {
    Port,
    Server,
    Route,
    Routes,
    Device,
    Point,
    Slave,
    Slaves,
    User,
    // Left out of images without TLS; also below.
    #[cfg(feature = "tls")]
    Certificate,
    // As its line; also below.
    #[cfg(feature = "mqtt")]
    Publisher,
}

/// Deletable items.
const THINGS: &[(&str, Thing)] = &[
    ("port", Thing::Port),
    ("server", Thing::Server),
    ("route", Thing::Route),
    ("routes", Thing::Routes),
    ("device", Thing::Device),
    ("point", Thing::Point),
    ("slave", Thing::Slave),
    ("slaves", Thing::Slaves),
    ("user", Thing::User),
    // As its line.
    #[cfg(feature = "tls")]
    ("certificate", Thing::Certificate),
    #[cfg(feature = "mqtt")]
    ("publish", Thing::Publisher),
];
const THINGS_EXPECTED: &str = listed!(THINGS);
const ROUTE: (&str, Thing) = ("route", Thing::Route);

/// The keywords of deletable items.
pub(crate) fn things() -> impl Iterator<Item = &'static str> {
    THINGS.iter().map(|(word, _)| *word)
}

/// `edit ...`
pub(crate) fn edit(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    match words.take().keyword(&[("port", Thing::Port), ROUTE], "port or route")? {
        Thing::Port => {
            let name_word = words.take();
            let (id, old) = existing_port(settings, name_word)?;
            let draft = Draft::edit(old, words)?;
            let port = Port { name: old.name.clone(), kind: draft.kind, units: draft.units };
            put_port(settings, id, port, name_word, draft.endpoint)
        }
        _ => {
            let at = route_place(settings, words.take())?;
            put_route(settings, words, at, true)
        }
    }
}

/// `insert route ...`
pub(crate) fn insert_route(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    words.take().keyword(&[ROUTE], "route")?;
    let at = route_place(settings, words.take())?;
    put_route(settings, words, at, false)
}

/// `move route ...`
pub(crate) fn move_route(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    words.take().keyword(&[ROUTE], "route")?;
    let from = route_place(settings, words.take())?;
    let to = route_place(settings, words.take())?;
    words.end()?;
    let span = settings.routes.get_mut(from.min(to)..=from.max(to)).unwrap_or_default();
    // Step by step: a rotation by any number is more code.
    for step in 1..span.len() {
        let at = if from < to { step } else { span.len() - step };
        span.swap(at - 1, at);
    }
    Ok(Changed::Rule(to))
}

/// `delete ...`
pub(crate) fn delete(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    match words.take().keyword(THINGS, THINGS_EXPECTED)? {
        Thing::Port => {
            let word = words.take();
            let (id, _) = existing_port(settings, word)?;
            words.end()?;
            let names = |route: &Route| route.source == id || route.destination == Destination::Port(id);
            if let Some(rules) = Rules::of(settings.routes.iter().map(names)) {
                return Err(word.error(Problem::PortInUse(rules)));
            }
            check_unused(settings, id, word)?;
            check_no_servers(settings, id, word)?;
            if let Some(slot) = settings.ports.get_mut(id.index()) {
                *slot = None;
            }
        }
        Thing::Server => return servers::delete_server(settings, words),
        Thing::Route => {
            let at = route_place(settings, words.take())?;
            words.end()?;
            settings.routes.remove(at);
        }
        Thing::Routes => {
            words.end()?;
            settings.routes.clear();
        }
        Thing::User if !USERS => return Err(words.take().error(Problem::NoUsers)),
        Thing::User => return users::delete_user(settings, words),
        #[cfg(feature = "tls")]
        Thing::Certificate => return certificates::delete_certificate(settings, words),
        #[cfg(feature = "mqtt")]
        Thing::Publisher => return publish::delete_publisher(settings, words),
        _ if !POINTS => return Err(words.take().error(Problem::NoPoints)),
        Thing::Slaves => {
            words.end()?;
            settings.slaves.clear();
        }
        thing => {
            let word = words.take();
            words.end()?;
            return match thing {
                Thing::Device => point_checks::delete_device(settings, word),
                Thing::Point => point_checks::delete_point(settings, word),
                _ => slaves::delete_slave(settings, word),
            };
        }
    }
    Ok(Changed::Other)
}

fn existing_port<'s>(settings: &'s Settings, word: Word) -> Result<(PortId, &'s Port), Wrong> {
    if word.is_end() {
        return Err(word.expected("a port name"));
    }
    let id = settings.find(word.text);
    id.and_then(|id| Some((id, settings.port(id)?))).ok_or_else(|| word.error(Problem::NoSuchPort))
}

/// The index of the rule with number `word`.
fn route_place(settings: &Settings, word: Word) -> Result<usize, Wrong> {
    let number = number(word, "a rule's number", 1..=ROUTES_MAX as u32)? as usize;
    let count = settings.routes.len();
    if number <= count { Ok(number - 1) } else { Err(word.error(Problem::NoSuchRoute(count))) }
}

const _: () = assert!(PORTS_MAX <= u8::MAX as usize, "PortId is a byte");
