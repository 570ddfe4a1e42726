//! The words of a server-side port that say what unit ids without a device of their own mean: 0, 255, 248 to 254.

use super::problem::Problem;
use super::values::small;
use super::words::{Word, Words, Wrong};
use super::{Special, UnitPolicy};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Key {
    Broadcast,
    Confirm(bool),
    Unit255,
    Reserved,
}

const KEYS: &[(&str, Key)] = &[
    ("broadcast", Key::Broadcast),
    ("confirm-broadcast", Key::Confirm(true)),
    // For `edit`: a flag has no value that could say so.
    ("no-confirm-broadcast", Key::Confirm(false)),
    ("unit-255", Key::Unit255),
    ("reserved-units", Key::Reserved),
];

/// What stands behind `replace` is a number, so this is not its meaning yet.
const MEANINGS: &[(&str, Special)] = &[
    ("rules", Special::Rules),
    ("off", Special::Off),
    ("local", Special::Local),
    ("replace", Special::Replace(0)),
];
const ALL_LINES: (&str, Special) = ("all", Special::AllLines);

/// The words that set something.
pub(super) fn keywords() -> impl Iterator<Item = &'static str> {
    KEYS.iter().map(|&(keyword, _)| keyword)
}

/// A policy while a line is read.
#[derive(Default)]
pub(super) struct UnitDraft<'a> {
    pub(super) policy: UnitPolicy,
    /// The last word that set something.
    pub(super) word: Option<Word<'a>>,
    seen: u8,
}

impl<'a> UnitDraft<'a> {
    pub(super) fn new(policy: UnitPolicy) -> Self {
        Self { policy, ..Self::default() }
    }

    /// Takes `word` and its value, if it is one of these words.
    pub(super) fn take(&mut self, word: Word<'a>, words: &Words) -> Result<bool, Wrong> {
        let Some(key) = word.lookup(KEYS) else { return Ok(false) };
        let bit = match key {
            Key::Broadcast => 1,
            Key::Confirm(_) => 2,
            Key::Unit255 => 4,
            Key::Reserved => 8,
        };
        if self.seen & bit != 0 {
            return Err(word.error(Problem::Twice));
        }
        self.seen |= bit;
        self.word = Some(word);
        match key {
            Key::Broadcast => self.policy.broadcast = meaning(words, true)?,
            Key::Confirm(confirm) => self.policy.confirm = confirm,
            Key::Unit255 => self.policy.unit_255 = meaning(words, false)?,
            Key::Reserved => self.policy.reserved = meaning(words, false)?,
        }
        Ok(true)
    }
}

fn meaning(words: &Words, broadcast: bool) -> Result<Special, Wrong> {
    let word = words.take();
    if broadcast && word.lookup(&[ALL_LINES]).is_some() {
        return Ok(Special::AllLines);
    }
    let expected =
        if broadcast { "rules, off, all, local or replace N" } else { "rules, off, local or replace N" };
    Ok(match word.keyword(MEANINGS, expected)? {
        Special::Replace(_) => Special::Replace(small(words.take(), "a unit id", 1..=247)?),
        meaning => meaning,
    })
}
