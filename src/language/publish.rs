//! Publishers: `publish plant mqtt broker 192.168.1.9 user gateway password "..." commands on`.

use core::fmt::{self, Display};
use core::ops::RangeInclusive;

use embassy_time::Duration;
use heapless::String;

use super::changed::Changed;
use super::listed::{keywords, listed};
use super::option::option;
use super::port_values::server_address;
use super::problem::Problem;
// Only the web interface has settings by name.
#[cfg(feature = "web")]
use super::shape::Shape;
use super::values::{named, time};
use super::words::{Word, Words, Wrong};
use crate::mqtt::Version;
use crate::settings::{
    Format, Name, PUBLISHERS_MAX, Publisher, ServerAddress, Settings, Time, TlsSettings, TopicPrefix,
};

keywords!(VERSIONS: Version { "3.1.1": V3, "5": V5 });
keywords!(FORMATS: Format { "json": Json, "homeassistant": HomeAssistant, "sparkplug": Sparkplug });

/// What a line has unless it says so.
const TOPIC: &str = "mobgate";
const EVERY: Duration = Duration::from_secs(60);

/// The word before the one word that is not shown.
const PASSWORD: &str = "password";

const EVERY_RANGE: RangeInclusive<Duration> = Duration::from_secs(1)..=Duration::from_secs(86_400);

/// The ports of brokers, without and with TLS (registered with IANA: mqtt, secure-mqtt).
const PORTS: [u16; 2] = [1883, 8883];

#[derive(Clone, Copy, PartialEq, Eq)]
enum Key {
    Version,
    // Left out of images without TLS; also below.
    #[cfg(feature = "tls")]
    Tls,
    #[cfg(feature = "tls")]
    Trust,
    #[cfg(feature = "tls")]
    Certificate,
    User,
    Password,
    Topic,
    Every,
    Format,
    Commands,
}

const KEYS: &[(&str, Key)] = &[
    ("version", Key::Version),
    #[cfg(feature = "tls")]
    ("tls", Key::Tls),
    #[cfg(feature = "tls")]
    ("trust", Key::Trust),
    #[cfg(feature = "tls")]
    ("certificate", Key::Certificate),
    ("user", Key::User),
    (PASSWORD, Key::Password),
    ("topic", Key::Topic),
    ("every", Key::Every),
    ("format", Key::Format),
    ("commands", Key::Commands),
];
const KEYS_EXPECTED: &str = listed!(KEYS);
const VERSIONS_EXPECTED: &str = listed!(VERSIONS);
const FORMATS_EXPECTED: &str = listed!(FORMATS);

/// The words of the line.
pub(crate) fn keywords() -> impl Iterator<Item = &'static str> {
    let values = FORMATS.iter().map(|(word, _)| *word).chain(["mqtt", "broker", "on", "off"]);
    KEYS.iter().map(|(word, _)| *word).chain(values)
}

/// Calls `each` with the keywords of the line and their types.
// Only the web interface has settings by name.
#[cfg(feature = "web")]
pub(crate) fn members(each: &mut dyn FnMut(&'static str, Shape)) {
    each("broker", Shape::Text);
    for (keyword, _) in KEYS {
        each(
            keyword,
            match *keyword {
                "tls" => Shape::Flag,
                PASSWORD => Shape::Quoted,
                _ => Shape::Text,
            },
        );
    }
}

/// Parses a publisher's name.
fn publisher_name(word: Word) -> Result<Name, Wrong> {
    named(word, "a publisher's name: a letter, then letters, digits, - _ or ., at most 15")
}

/// A publisher with what a line has by default.
fn plain(name: Name, broker: ServerAddress) -> Publisher {
    Publisher {
        name,
        broker,
        version: Version::V5,
        tls: TlsSettings { on: false, certificate: None, trust: None },
        user: String::new(),
        password: String::new(),
        topic: TopicPrefix::try_from(TOPIC).unwrap_or_default(),
        every: EVERY,
        format: Format::Json,
        commands: false,
    }
}

/// Parses a publisher up to the end of the line, and stores it instead of the one of that name. The password stays unless the line has
/// one, for the same user of the same broker: whoever changes those must know it.
pub(crate) fn publish(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    let word = words.take();
    let name = publisher_name(word)?;
    words.take().keyword(&[("mqtt", ())], "mqtt")?;
    words.take().keyword(&[("broker", ())], "broker and its address")?;
    let mut publisher = plain(name, server_address(words.take(), 0)?);
    options(&mut publisher, words)?;
    let [usual, usual_by_tls] = PORTS;
    if publisher.broker.port == 0 {
        publisher.broker.port = if publisher.tls.on { usual_by_tls } else { usual };
    }
    #[cfg(feature = "tls")]
    if let Some(problem) = super::certificates::lacks_of_publisher(settings, &publisher) {
        return Err(word.error(problem));
    }
    match settings.publishers.iter_mut().find(|other| other.name.eq_ignore_ascii_case(&publisher.name)) {
        Some(old) => {
            let is_same =
                (&old.broker, &old.tls, &old.user) == (&publisher.broker, &publisher.tls, &publisher.user);
            if publisher.password.is_empty() && is_same {
                publisher.password.clone_from(&old.password);
            }
            *old = publisher;
        }
        None => {
            let full = settings.publishers.push(publisher);
            full.map_err(|_| word.error(Problem::PublishersFull(PUBLISHERS_MAX)))?;
        }
    }
    Ok(Changed::Other)
}

/// The options of a line, in any order.
fn options(publisher: &mut Publisher, words: &Words<'_>) -> Result<(), Wrong> {
    let (mut seen, mut group, mut every) = (0_u16, None, None);
    while !words.peek().is_end() {
        let word = words.take();
        let key = word.keyword(KEYS, KEYS_EXPECTED)?;
        let bit = 1 << key as u8;
        if seen & bit != 0 {
            return Err(word.error(Problem::Twice));
        }
        seen |= bit;
        match key {
            Key::Topic => group = Some(words.peek()),
            Key::Every => every = Some(word),
            _ => {}
        }
        set(publisher, key, word, words)?;
    }
    match publisher.format {
        Format::Sparkplug => fits_sparkplug(group, every),
        Format::Json | Format::HomeAssistant => Ok(()),
    }
}

/// The topic is a group, which is one level of a topic (Sparkplug 4.1.2), and values are sent when they change (2.2).
fn fits_sparkplug(group: Option<Word<'_>>, every: Option<Word<'_>>) -> Result<(), Wrong> {
    match (group.filter(|group| group.text.contains('/')), every) {
        (Some(group), _) => Err(group.expected("a group of Sparkplug, which has no /")),
        (None, Some(every)) => Err(every.error(Problem::EveryWithSparkplug)),
        (None, None) => Ok(()),
    }
}

fn set(publisher: &mut Publisher, key: Key, word: Word<'_>, words: &Words<'_>) -> Result<(), Wrong> {
    match key {
        Key::Version => publisher.version = words.take().keyword(VERSIONS, VERSIONS_EXPECTED)?,
        #[cfg(feature = "tls")]
        Key::Tls => publisher.tls.on = true,
        #[cfg(feature = "tls")]
        Key::Trust | Key::Certificate if !publisher.tls.on => return Err(word.error(Problem::TlsOnly)),
        #[cfg(feature = "tls")]
        Key::Trust => publisher.tls.trust = Some(super::certificates::certificate_name(words.take())?),
        #[cfg(feature = "tls")]
        Key::Certificate => {
            publisher.tls.certificate = Some(super::certificates::certificate_name(words.take())?);
        }
        Key::User => {
            publisher.user = visible(words.take(), "a user name of the broker, at most 63 characters")?
        }
        Key::Password if publisher.user.is_empty() => {
            return Err(word.expected("user NAME before the password"));
        }
        Key::Password => {
            let text = words.take_quoted().text;
            let is_good = !text.is_empty() && !text.contains(|char: char| char == '"' || char.is_control());
            let password = if is_good { String::try_from(text).ok() } else { None };
            // The error shows no part of it.
            publisher.password = password
                .ok_or_else(|| word.expected("the password behind it, in quotes, at most 127 bytes"))?;
        }
        Key::Topic => publisher.topic = topic(words.take())?,
        Key::Every => publisher.every = time(words.take(), &EVERY_RANGE)?,
        Key::Format => publisher.format = words.take().keyword(FORMATS, FORMATS_EXPECTED)?,
        Key::Commands => {
            publisher.commands = words.take().keyword(&[("on", true), ("off", false)], "on or off")?;
        }
    }
    Ok(())
}

fn visible<const N: usize>(word: Word<'_>, expected: &'static str) -> Result<String<N>, Wrong> {
    let is_good = !word.is_end() && word.text.bytes().all(|byte| byte.is_ascii_graphic());
    let text = if is_good { String::try_from(word.text).ok() } else { None };
    text.ok_or_else(|| word.expected(expected))
}

/// Levels of letters, digits and some signs: no wildcard, and nothing that JSON or Home Assistant would take for something else.
fn topic(word: Word<'_>) -> Result<TopicPrefix, Wrong> {
    let is_level = |level: &str| {
        !level.is_empty() && level.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte))
    };
    let topic = if word.text.split('/').all(is_level) { TopicPrefix::try_from(word.text).ok() } else { None };
    topic.ok_or_else(|| {
        word.expected("a topic such as plant/cabinet-7: letters, digits, - _ . and /, at most 31")
    })
}

/// Deletes a publisher.
pub(crate) fn delete_publisher(settings: &mut Settings, words: &Words<'_>) -> Result<Changed, Wrong> {
    let word = words.take();
    words.end()?;
    let at = settings.publishers.iter().position(|other| other.name.eq_ignore_ascii_case(word.text));
    settings.publishers.remove(at.ok_or_else(|| word.error(Problem::NoSuchPublisher))?);
    Ok(Changed::Other)
}

/// The words after `publish`.
pub(crate) struct PublisherWords<'p> {
    pub(crate) publisher: &'p Publisher,
    /// Whether the password is shown.
    pub(crate) secrets: bool,
}

impl Display for PublisherWords<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Publisher { name, broker, version, tls, user, password, topic, every, format, commands } =
            self.publisher;
        write!(f, "{name} mqtt broker {broker}")?;
        option(f, "version", version, *version != Version::V5)?;
        if tls.on {
            f.write_str(" tls")?;
        }
        for (word, name) in [("trust", &tls.trust), ("certificate", &tls.certificate)] {
            if let Some(name) = name {
                option(f, word, name, true)?;
            }
        }
        option(f, "user", user, !user.is_empty())?;
        if self.secrets && !password.is_empty() {
            write!(f, " {PASSWORD} \"{password}\"")?;
        }
        option(f, "topic", topic, *topic != TOPIC)?;
        option(f, "every", &Time(*every), *every != EVERY)?;
        option(f, "format", format, *format != Format::Json)?;
        option(f, "commands", &"on", *commands)
    }
}
