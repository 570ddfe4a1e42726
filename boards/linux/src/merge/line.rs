//! A line of a text of settings: the item that it creates, and its comment.

use mobgate::language::{apply, write_line};
use mobgate::settings::Settings;

/// First words of the lines, in the order in which a text needs them.
const KINDS: [&str; 13] = [
    "user",
    "network",
    "mdns",
    "syslog",
    "ntp",
    "certificate",
    "publish",
    "port",
    "server",
    "route",
    "device",
    "point",
    "slave",
];
const USER: usize = 0;
const NETWORK: usize = 1;
pub(super) const MDNS: usize = 2;
const SYSLOG: usize = 3;
const NTP: usize = 4;
const SERVER: usize = 8;
pub(super) const ROUTE: usize = 9;

/// A line that creates something, as printed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Item {
    pub(super) kind: usize,
    /// Identifies it among others of its kind; empty for rules and for what is there once.
    pub(super) name: String,
    pub(super) text: String,
    /// Without alignment blanks.
    pub(super) words: Vec<String>,
}

impl Item {
    /// Parses the printed `line`.
    pub(super) fn of(line: &str) -> Option<Self> {
        let words = split(line).0.into_iter().map(str::to_owned).collect::<Vec<_>>();
        let kind = kind(words.first()?)?;
        Some(Self { kind, name: name(kind, &words), text: line.to_owned(), words })
    }

    pub(super) fn says_the_same(&self, other: &Self) -> bool {
        self.words == other.words
    }
}

/// What identifies a line of this kind among others. Users and keys differ by case, too.
fn name(kind: usize, words: &[impl AsRef<str>]) -> String {
    let word = |nth: usize| words.get(nth).map_or("", AsRef::as_ref);
    match kind {
        NETWORK | MDNS | SYSLOG | NTP | ROUTE => String::new(),
        // The port, `unit` and the units.
        SERVER => [1, 2, 3].map(word).join(" ").to_lowercase(),
        USER if word(2).eq_ignore_ascii_case("key") => format!("{} {}", word(1), word(4)),
        USER => word(1).to_owned(),
        _ => word(1).to_lowercase(),
    }
}

fn kind(verb: &str) -> Option<usize> {
    KINDS.iter().position(|kind| kind.eq_ignore_ascii_case(verb))
}

/// Line `n` of the printed `settings`.
pub(super) fn printed(settings: &Settings, n: usize) -> Option<Item> {
    let mut text = String::new();
    // Writing to a `String` cannot fail.
    write_line(settings, n, &mut text).and_then(|_| Item::of(&text))
}

/// A line of a text.
pub(super) struct Line<'t> {
    /// With its line end.
    pub(super) raw: &'t str,
    /// Starts at the `#`.
    pub(super) comment: Option<&'t str>,
    pub(super) does: Does,
}

pub(super) enum Does {
    /// It is blank, or a comment.
    Nothing,
    /// It creates this item.
    Makes(Item),
    /// It changes or deletes what other lines created.
    Edits,
    /// It has an error.
    Wrong,
}

impl<'t> Line<'t> {
    /// Parses a line and applies it to `settings`.
    pub(super) fn read(raw: &'t str, settings: &mut Settings) -> Self {
        let line = raw.trim_end_matches(['\n', '\r']);
        let (words, comment) = split(line);
        let does = match (apply(settings, line), words.first()) {
            (Err(_), _) => Does::Wrong,
            (Ok(_), None) => Does::Nothing,
            (Ok(_), Some(verb)) => made(settings, verb, &words).map_or(Does::Edits, Does::Makes),
        };
        Self { raw, comment, does }
    }
}

/// The item just created by a line of these words.
fn made(settings: &Settings, verb: &str, words: &[&str]) -> Option<Item> {
    let kind = kind(verb)?;
    if kind == MDNS {
        return Item::of(&format!("mdns {}", settings.mdns));
    }
    let name = name(kind, words);
    let is_it = |item: &Item| kind == SERVER || item.name.is_empty() || item.name == name;
    // A new rule or server comes after the others.
    (0..).map_while(|n| printed(settings, n)).filter(|item| item.kind == kind).filter(is_it).last()
}

/// Splits a line into its words and the trailing comment.
fn split(line: &str) -> (Vec<&str>, Option<&str>) {
    let is_blank = |character: char| character.is_ascii_whitespace() || character == ',';
    let (mut words, mut rest) = (Vec::new(), line);
    loop {
        rest = rest.trim_start_matches(is_blank);
        if rest.is_empty() {
            return (words, None);
        }
        if rest.starts_with('#') {
            return (words, Some(rest.trim_end()));
        }
        let quoted = rest.strip_prefix('"').and_then(|rest| rest.find('"')).map(|end| end + 2);
        let end = quoted.or_else(|| rest.find(is_blank)).unwrap_or(rest.len());
        let (word, behind) = rest.split_at(end);
        words.push(word);
        rest = behind;
    }
}
