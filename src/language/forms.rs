//! The structure of settings lines, for interfaces that use names and types instead of words.
//!
//! A line has columns, whose names are here, and options behind them: the keywords and fields by which lines are parsed and
//! printed.

use core::fmt;

use super::port_keys::UNIT_KEYS;
use super::port_kinds::new_port;
pub(crate) use super::shape::Shape;
use super::shape::{KIND, Member, NAME};
use super::words::Words;
// As its verb.
#[cfg(feature = "mqtt")]
use super::publish;
use super::{own_network, point_options, route_words, servers, slaves};
use crate::scanner::POINTS;
use crate::settings::{AUDIT, BAUD, PortKind, SERVERS, SLAVES_MAX, TLS, USERS, UnitPolicy};

/// The lines of a verb, or of one kind of port.
#[derive(Clone, Copy)]
pub(crate) struct Form {
    pub(crate) verb: &'static str,
    /// A port's kind, as its line has it.
    pub(crate) kind: Option<&'static str>,
    /// The words between the verb and the options, in their order; a port's kind is the second of them.
    pub(crate) columns: &'static [Member],
    /// The last column may be missing.
    pub(crate) open: bool,
    options: Options,
}

/// The options of a form.
#[derive(Clone, Copy)]
enum Options {
    /// Those of the port that this line begins.
    OfPort(&'static str),
    /// Those passed on by this function.
    Each(fn(&mut dyn FnMut(&'static str, Shape))),
}

const TEXT: Shape = Shape::Text;
const ROUTE: &[Member] =
    &[("source", TEXT), ("units", TEXT), ("from", TEXT), ("tag", TEXT), ("destination", TEXT)];
const POINT: &[Member] = &[NAME, ("at", TEXT), ("table", TEXT), ("address", Shape::Number(0, 0xffff))];
const SLAVE: &[Member] = &[("number", Shape::Number(0, SLAVES_MAX.saturating_sub(1) as u32))];

/// A kind of port: how its line begins behind the name, its columns, and the shortest line of it.
type Line = (&'static str, &'static [Member], &'static str);

const LISTEN: &[Member] = &[NAME, KIND, ("listen", TEXT)];

/// All kinds of port. What this image lacks is refused by [`new_port`].
const PORTS: &[Line] = &[
    (
        "serial",
        &[
            NAME,
            KIND,
            ("device", TEXT),
            ("framing", TEXT),
            ("side", TEXT),
            ("baud", Shape::Number(*BAUD.start(), *BAUD.end())),
            ("format", TEXT),
        ],
        "serial -",
    ),
    ("tcp server", LISTEN, "tcp server 1"),
    ("tcp client listen", LISTEN, "tcp client listen 1"),
    ("tcp client", &[NAME, KIND, ("address", TEXT)], "tcp client 127.0.0.1"),
    ("udp server", LISTEN, "udp server 1"),
    ("http server", LISTEN, "http server 1"),
    ("ssh server", LISTEN, "ssh server 1"),
    ("ethercat", &[NAME, KIND], "ethercat"),
    ("scanner", &[NAME, KIND], "scanner"),
];

const fn form(verb: &'static str, columns: &'static [Member], options: Options) -> Form {
    Form { verb, kind: None, columns, open: false, options }
}

fn port(&(kind, columns, example): &Line) -> Form {
    // A TCP client without an address has several servers.
    let open = kind == "tcp client";
    Form { kind: Some(kind), open, ..form("port", columns, Options::OfPort(example)) }
}

/// The forms of the lines that are printed before those of ports,
const BEFORE_PORTS: &[Form] = &[
    form(
        "user",
        &[NAME],
        Options::Each(|each| ["role", "key"].into_iter().for_each(|word| each(word, TEXT))),
    ),
    form(
        "network",
        &[],
        Options::Each(|each| own_network::keywords().for_each(|word| each(word, of_network(word)))),
    ),
    form("mdns", &[("state", TEXT)], Options::Each(|each| each("name", TEXT))),
    form("syslog", &[("transport", TEXT), ("server", TEXT)], Options::Each(|_| {})),
    form("ntp", &[("server", TEXT)], Options::Each(|_| {})),
    form(
        "certificate",
        &[NAME, ("purpose", TEXT), ("file", TEXT)],
        Options::Each(|each| ["key", "revoked"].into_iter().for_each(|word| each(word, TEXT))),
    ),
    #[cfg(feature = "mqtt")]
    form("publish", &[NAME, ("protocol", TEXT)], Options::Each(publish::members)),
];

/// and after them.
const AFTER_PORTS: &[Form] = &[
    form("server", &[("port", TEXT)], Options::Each(servers::members)),
    form("route", ROUTE, Options::Each(route_words::members)),
    form("device", &[NAME], Options::Each(|each| point_options::members(false, each))),
    form("point", POINT, Options::Each(|each| point_options::members(true, each))),
    form("slave", SLAVE, Options::Each(slaves::members)),
];

fn of_network(keyword: &str) -> Shape {
    if keyword == "dhcp" { Shape::Flag } else { TEXT }
}

/// The forms of this image's lines, in the order in which they are printed.
pub(crate) fn forms() -> impl Iterator<Item = Form> {
    let all = BEFORE_PORTS.iter().copied().chain(PORTS.iter().map(port)).chain(AFTER_PORTS.iter().copied());
    all.filter(|form| match form.options {
        Options::OfPort(example) => new_port(&Words::new(example)).is_ok(),
        Options::Each(_) => match form.verb {
            "user" => USERS,
            "syslog" | "ntp" => AUDIT,
            "certificate" => TLS,
            "server" => SERVERS,
            "device" | "point" | "slave" => POINTS,
            _ => true,
        },
    })
}

impl Form {
    /// Calls `each` with the options and their types.
    pub(crate) fn options(&self, each: &mut dyn FnMut(&'static str, Shape)) {
        match self.options {
            Options::Each(pass) => pass(each),
            Options::OfPort(example) => {
                if let Ok((kind, _)) = new_port(&Words::new(example)) {
                    self.options_of_port(kind, each);
                }
            }
        }
    }

    fn options_of_port(&self, mut kind: PortKind, each: &mut dyn FnMut(&'static str, Shape)) {
        let (keys, _) = kind.words();
        let mut units = UnitPolicy::default();
        let has_units = kind.has_units();
        for &(keyword, key) in keys.iter().chain(UNIT_KEYS.iter().filter(|_| has_units)) {
            if self.columns.iter().any(|(column, _)| *column == keyword) {
                continue;
            }
            let field = kind.field(key).or_else(|| units.field(key));
            field.and_then(|field| field.shape()).into_iter().for_each(|shape| each(keyword, shape));
        }
    }

    /// The type of the column or option `name`.
    pub(crate) fn member(&self, name: &str) -> Option<Shape> {
        let column = self.columns.iter().find(|(column, _)| *column == name).map(|(_, shape)| *shape);
        column.or_else(|| self.option(name).map(|(_, shape)| shape))
    }

    fn option(&self, name: &str) -> Option<Member> {
        let mut found = None;
        self.options(&mut |keyword, shape| {
            if keyword.eq_ignore_ascii_case(name) {
                found = Some((keyword, shape));
            }
        });
        found
    }

    /// The form of a line.
    fn of(line: &str) -> Option<Self> {
        let words = Words::new(line);
        let verb = words.take().text;
        words.take();
        let is_kind = |kind: &str| {
            let words = Words::new(words.rest());
            kind.split(' ').all(|word| words.take().is(word))
        };
        forms().find(|form| form.verb == verb && form.kind.is_none_or(is_kind))
    }
}

/// Calls `each` with the verb of a printed line and with each of its members: name, type and words.
pub(crate) fn members(
    line: &str,
    each: &mut dyn FnMut(&'static str, Member, &str) -> fmt::Result,
) -> fmt::Result {
    let form = Form::of(line).ok_or(fmt::Error)?;
    let words = Words::new(line);
    words.take();
    for (nth, &(column, shape)) in form.columns.iter().enumerate() {
        let is_missing = words.peek().is_end() || form.option(words.peek().text).is_some();
        if form.open && nth + 1 == form.columns.len() && is_missing {
            break;
        }
        let kind = form.kind.filter(|_| column == KIND.0);
        let word = match kind {
            Some(kind) => kind.split(' ').fold(kind, |kind, _| {
                words.take();
                kind
            }),
            None => words.take().text,
        };
        each(form.verb, (column, shape), word)?;
    }
    while !words.peek().is_end() {
        let (keyword, shape) = form.option(words.take().text).ok_or(fmt::Error)?;
        let value = match shape {
            Shape::Flag => "",
            Shape::Quoted => words.take_quoted().text,
            _ => value(&form, &words),
        };
        each(form.verb, (keyword, shape), value)?;
    }
    Ok(())
}

/// The words up to the next option; a list goes on where there is a comma.
fn value<'w>(form: &Form, words: &'w Words) -> &'w str {
    let begin = words.rest();
    words.take();
    loop {
        let next = words.peek();
        if next.is_end() || (!next.listed && form.option(next.text).is_some()) {
            break;
        }
        words.take();
    }
    begin.get(..begin.len() - words.rest().len()).unwrap_or_default().trim_ascii()
}
