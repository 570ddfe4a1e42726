//! The line of a rule, column by column as in the MobGate paper: source, units, IP, TAG, destination; then options.

use core::ops::RangeInclusive;

use embassy_time::Duration;

use super::listed::keywords;
use super::problem::Problem;
#[cfg(feature = "web")] // As what uses it.
use super::shape::Shape;
use super::values::{parse_number, prefix, small, span, time};
use super::words::{Word, Words, Wrong};
use crate::settings::{
    AddressRange, ClientRole, Cut, Destination, Forbidden, Functions, IpPrefix, Merge, Policy, PortId,
    Priority, Route, Settings, TLS, Tag, UnitRange,
};

/// The text of the options, with the last of them.
macro_rules! options_expected {
    ($last:literal) => {
        concat!("readonly, all, functions 3,4,16, addresses 0-99, writes 10-19, forbidden refuse|ignore, priority high|normal|low, urgent 5,6, merge on|off|adjacent|near N, \
     cache 1s", $last)
    };
}
const OPTIONS_EXPECTED: &str = if TLS {
    options_expected!(", cut auto|on|off or role NAME")
} else {
    options_expected!(" or cut auto|on|off")
};

/// Device identification, without the rest of function 43.
pub(crate) const IDENTIFICATION: &str = "43/14";

/// The maximum age of a cached response.
const CACHE: RangeInclusive<Duration> = Duration::from_ticks(0)..=Duration::from_secs(60);

/// Parses one rule up to the end of the line and checks it against the ports.
pub(crate) fn route(settings: &Settings, words: &Words) -> Result<Route, Wrong> {
    let source_word = words.take();
    let source = port(settings, source_word)?;
    let units = units(words.take())?;
    let peer = peer(settings, source, words.take())?;
    let tag = tag(words.take(), units)?;
    let destination_word = words.take();
    let destination = destination(settings, destination_word)?;
    if destination == Destination::Port(source) {
        return Err(destination_word.error(Problem::ToItself));
    }
    let has_roles = settings.port(source).is_some_and(|port| port.kind.has_roles());
    let (role, policy) = options(words, has_roles)?;
    Ok(Route { source, units, peer, role, tag, destination, policy })
}

pub(crate) fn port(settings: &Settings, word: Word) -> Result<PortId, Wrong> {
    if word.is_end() {
        return Err(word.expected("a port name"));
    }
    settings.find(word.text).ok_or_else(|| word.error(Problem::NoSuchPort))
}

/// Parses units: `7`, `1-64` or `*`.
pub(crate) fn units(word: Word) -> Result<UnitRange, Wrong> {
    if word.text == "*" {
        return Ok(UnitRange::ALL);
    }
    let (first, last) = span(word, 0..=255, "a unit id from 0 to 255, a range such as 1-64, or *")?;
    Ok(UnitRange { first: first as u8, last: last as u8 })
}

fn peer(settings: &Settings, source: PortId, word: Word) -> Result<Option<IpPrefix>, Wrong> {
    if word.text == "*" {
        return Ok(None);
    }
    let peer = prefix(word).map_err(|_| {
        word.expected("an IP address such as 192.168.1.7, a prefix such as 192.168.1.0/24, or *")
    })?;
    // The rule would never match.
    if settings.port(source).is_some_and(|port| !port.kind.has_peers()) {
        return Err(word.error(Problem::PeerOfSerial));
    }
    Ok(Some(peer))
}

pub(crate) fn tag(word: Word, units: UnitRange) -> Result<Tag, Wrong> {
    let expected = "* (the unit id stays), +N or -N (is shifted), or =N (becomes N)";
    if word.text == "*" {
        return Ok(Tag::Keep);
    }
    let value = |sign| {
        let digits = word.text.strip_prefix(sign)?;
        parse_number(digits).and_then(|value| u8::try_from(value).ok())
    };
    let tag = match (value('+'), value('-'), value('=')) {
        (Some(0), _, _) | (_, Some(0), _) => Tag::Keep,
        (Some(by), _, _) => Tag::Add(by),
        (_, Some(by), _) => Tag::Subtract(by),
        (_, _, Some(unit)) => Tag::Set(unit),
        _ => return Err(word.expected(expected)),
    };
    match (units.first..=units.last).find(|unit| tag.apply(*unit).is_none()) {
        Some(unit) => {
            let target = match tag {
                Tag::Keep => unit.into(),
                Tag::Add(by) => i16::from(unit) + i16::from(by),
                Tag::Subtract(by) => i16::from(unit) - i16::from(by),
                Tag::Set(target) => target.into(),
            };
            Err(word.error(Problem::TagOutside { unit, target }))
        }
        None => Ok(tag),
    }
}

fn destination(settings: &Settings, word: Word) -> Result<Destination, Wrong> {
    if word.is_end() {
        return Err(word.expected("a port name, local, discard or nopath"));
    }
    match word.lookup(DESTINATIONS) {
        Some(destination) => Ok(destination),
        None => port(settings, word).map(Destination::Port),
    }
}

#[derive(Clone, Copy)]
enum Key {
    Role,
    Functions,
    ReadOnly,
    All,
    Addresses,
    Writes,
    Forbidden,
    Priority,
    Urgent,
    Merge,
    Cache,
    Cut,
}

const KEYS: &[(&str, Key)] = &[
    ("role", Key::Role),
    ("readonly", Key::ReadOnly),
    ("all", Key::All),
    ("functions", Key::Functions),
    ("addresses", Key::Addresses),
    ("writes", Key::Writes),
    ("forbidden", Key::Forbidden),
    ("priority", Key::Priority),
    ("urgent", Key::Urgent),
    ("merge", Key::Merge),
    ("cache", Key::Cache),
    ("cut", Key::Cut),
];

const DESTINATIONS: &[(&str, Destination)] =
    &[("local", Destination::Local), ("discard", Destination::Discard), ("nopath", Destination::NoPath)];

/// The entry without a value is followed by a number.
const MERGES: &[(&str, Option<Merge>)] = &[
    ("on", Some(Merge::Identical)),
    ("off", Some(Merge::Off)),
    ("adjacent", Some(Merge::Near(0))),
    ("near", None),
];

keywords!(FORBIDDEN: Forbidden { "refuse": Refuse, "ignore": Ignore });

keywords!(PRIORITIES: Priority { "high": High, "normal": Normal, "low": Low });

keywords!(CUTS: Cut { "auto": Auto, "on": On, "off": Off });

/// Calls `each` with the keywords of the columns and options.
pub(crate) fn keywords(each: &mut dyn FnMut(&'static str)) {
    KEYS.iter().for_each(|&(keyword, _)| each(keyword));
    DESTINATIONS.iter().for_each(|&(keyword, _)| each(keyword));
    FORBIDDEN.iter().for_each(|&(keyword, _)| each(keyword));
    PRIORITIES.iter().for_each(|&(keyword, _)| each(keyword));
    CUTS.iter().for_each(|&(keyword, _)| each(keyword));
    MERGES.iter().for_each(|&(keyword, _)| each(keyword));
}

/// Calls `each` with the options and their types.
// Only the web interface has settings by name.
#[cfg(feature = "web")]
pub(crate) fn members(each: &mut dyn FnMut(&'static str, Shape)) {
    for &(keyword, key) in KEYS.iter().filter(|(_, key)| TLS || !matches!(key, Key::Role)) {
        each(keyword, if matches!(key, Key::ReadOnly | Key::All) { Shape::Flag } else { Shape::Text });
    }
}

fn options(words: &Words, has_roles: bool) -> Result<(ClientRole, Policy), Wrong> {
    let (mut role, mut policy) = (ClientRole::NONE, Policy::default());
    let mut seen = 0_u16;
    while !words.peek().is_end() {
        let word = words.take();
        let key = word.keyword(KEYS, OPTIONS_EXPECTED)?;
        match key {
            Key::Role if !TLS => return Err(word.error(Problem::NoTls)),
            Key::Role if !has_roles => return Err(word.error(Problem::NoRoles)),
            Key::Role => role = client_role(words.take())?,
            Key::ReadOnly => policy.functions = Functions::READ_ONLY,
            Key::All => policy.functions = Functions::ALL,
            Key::Functions => policy.functions = function_list(words)?,
            Key::Addresses => policy.addresses = addresses(words.take())?,
            Key::Writes => policy.writes = addresses(words.take())?,
            Key::Forbidden => policy.forbidden = words.take().keyword(FORBIDDEN, "refuse or ignore")?,
            Key::Priority => policy.priority = words.take().keyword(PRIORITIES, "high, normal or low")?,
            Key::Urgent => policy.urgent = function_list(words)?,
            Key::Merge => policy.sharing.merge = merge(words)?,
            Key::Cache => policy.sharing.cache_ms = cache(words.take())?,
            Key::Cut => policy.cut = words.take().keyword(CUTS, "auto, on or off")?,
        }
        // Three keywords set the functions.
        let thing = if matches!(key, Key::ReadOnly | Key::All) { Key::Functions } else { key };
        if seen & 1 << thing as u8 != 0 {
            return Err(word.error(Problem::Twice));
        }
        seen |= 1 << thing as u8;
    }
    Ok((role, policy))
}

/// The role in clients' certificates.
pub(crate) fn client_role(word: Word) -> Result<ClientRole, Wrong> {
    let expected = "the role in clients' certificates: at most 31 visible characters without , and \"";
    ClientRole::new(word.text).ok_or_else(|| word.expected(expected))
}

/// `on`, `off`, `adjacent`, or `near 8`.
fn merge(words: &Words) -> Result<Merge, Wrong> {
    match words.take().keyword(MERGES, "on, off, adjacent or near N")? {
        Some(merge) => Ok(merge),
        None => Ok(Merge::Near(small(words.take(), "addresses between two reads", 1..=u8::MAX)?)),
    }
}

/// `500ms`: in whole milliseconds.
fn cache(word: Word) -> Result<u16, Wrong> {
    let age = time(word, &CACHE)?;
    let ms = u16::try_from(age.as_millis()).ok().filter(|ms| Duration::from_millis((*ms).into()) == age);
    ms.ok_or_else(|| word.expected("whole milliseconds"))
}

/// `100`, or `0-99`: addresses as on the wire.
fn addresses(word: Word) -> Result<AddressRange, Wrong> {
    let (first, last) = span(word, 0..=0xffff, "addresses from 0 to 65535, such as 0-99")?;
    Ok(AddressRange { first: first as u16, last: last as u16 })
}

/// `3,4,16`, with ranges: `1-4,43`, and `43/14` for device identification alone; or a named set.
fn function_list(words: &Words) -> Result<Functions, Wrong> {
    let sets = [("readonly", Functions::READ_ONLY), ("all", Functions::ALL)];
    if let Some(set) = words.peek().lookup(&sets) {
        words.take();
        return Ok(set);
    }
    let mut functions = Functions::NONE;
    loop {
        let word = words.take();
        functions = if word.is(IDENTIFICATION) {
            functions.with_identification()
        } else {
            let expected = "function codes from 1 to 127, such as 3,4,16 or 1-6, or 43/14";
            let (first, last) = span(word, 1..=127, expected)?;
            (first as u8..=last as u8).fold(functions, Functions::with)
        };
        let next = words.peek();
        if next.is_end() || !next.listed {
            return Ok(functions);
        }
    }
}
