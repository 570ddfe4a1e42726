//! The options of devices and points, and what each one sets.

use core::ops::RangeInclusive;

use super::listed::listed;
use super::long_words::{self, VALUE_KEYWORDS, WRITING_EXPECTED, check_scale, value_type};
use super::point_checks::existing_point;
use super::point_problem::PointProblem;
use super::points::usual_reading;
use super::problem::Problem;
#[cfg(feature = "web")] // As what uses it.
use super::shape::Shape;
use super::values::{PERIOD, medium, small, whole_ms};
use super::words::{Word, Words, Wrong};
use crate::scanner::{Reading, RegisterBit, RegisterBits, ValueType, Writing};
use crate::settings::{LABEL_BYTES_MAX, Label, PointAt, PointSettings, Settings};

/// Limits of these lines' numbers.
pub(super) const UNITS: RangeInclusive<u8> = 1..=255;
const COUNTS: RangeInclusive<u16> = 1..=1_968;
const QUALITIES: RangeInclusive<u16> = 0..=u16::MAX - 1;

const READINGS: &[(&str, Reading)] = &[
    ("low", Reading::Low),
    ("normal", Reading::Normal),
    ("high", Reading::High),
    ("manual", Reading::Manual),
];

const WRITINGS: &[(&str, Writing)] =
    &[("auto", Writing::Auto), ("change", Writing::OnChange), ("manual", Writing::Manual)];

#[derive(Clone, Copy, PartialEq, Eq)]
#[cfg_attr(not(feature = "long-values"), allow(dead_code))] // Its words are refused.
pub(super) enum Key {
    Unit,
    Order,
    Check,
    Label,
    Count,
    As,
    Read,
    Write,
    Multiple,
    Of,
    Quality,
    Bit,
    Bits,
    Scale,
    Offset,
}

pub(super) const DEVICE_KEYS: &[(&str, Key)] =
    &[("unit", Key::Unit), ("order", Key::Order), ("check", Key::Check), ("label", Key::Label)];

const POINT_KEYS: &[(&str, Key)] = &[
    ("count", Key::Count),
    ("as", Key::As),
    ("bit", Key::Bit),
    ("read", Key::Read),
    ("write", Key::Write),
    ("multiple", Key::Multiple),
    // Other images refuse them.
    #[cfg(feature = "long-values")]
    ("bits", Key::Bits),
    #[cfg(feature = "long-values")]
    ("scale", Key::Scale),
    #[cfg(feature = "long-values")]
    ("offset", Key::Offset),
    ("label", Key::Label),
];

const LOCAL_KEYS: &[(&str, Key)] = &[
    ("count", Key::Count),
    ("as", Key::As),
    ("of", Key::Of),
    ("quality", Key::Quality),
    // As above.
    #[cfg(feature = "long-values")]
    ("scale", Key::Scale),
    #[cfg(feature = "long-values")]
    ("offset", Key::Offset),
    ("label", Key::Label),
];

/// Calls `each` with the keywords of these options.
pub(super) fn keywords(each: &mut dyn FnMut(&'static str)) {
    DEVICE_KEYS.iter().for_each(|&(keyword, _)| each(keyword));
    // `label` is one keyword, though several lines have it.
    let others = POINT_KEYS.iter().filter(|(_, key)| *key != Key::Label);
    others.for_each(|&(keyword, _)| each(keyword));
    ["of", "quality"].into_iter().for_each(&mut *each);
    VALUE_KEYWORDS.iter().for_each(|keyword| each(keyword));
}

/// Passes the options of a device and their types, or those of a point.
// Only the web interface has settings by name.
#[cfg(feature = "web")]
pub(crate) fn members(of_point: bool, each: &mut dyn FnMut(&'static str, Shape)) {
    let [first, second] = if of_point { [POINT_KEYS, LOCAL_KEYS] } else { [DEVICE_KEYS, &[]] };
    let is_new = |(keyword, _): &&(&str, Key)| !first.iter().any(|(known, _)| known == keyword);
    for &(keyword, key) in first.iter().chain(second.iter().filter(is_new)) {
        let shape = match key {
            Key::Check | Key::Multiple => Shape::Flag,
            Key::Unit => Shape::number(UNITS),
            Key::Count => Shape::number(COUNTS),
            Key::Bit => Shape::Number(0, RegisterBit::ALL.len() as u32 - 1),
            Key::Quality => Shape::number(QUALITIES),
            Key::Label => Shape::Quoted,
            Key::Order | Key::As | Key::Read | Key::Write | Key::Of => Shape::Text,
            Key::Bits | Key::Scale | Key::Offset => Shape::Text,
        };
        each(keyword, shape);
    }
}

/// The keywords a line has had so far.
#[derive(Default)]
pub(super) struct Seen(u16);

impl Seen {
    pub(super) fn once(&mut self, key: Key, word: Word) -> Result<(), Wrong> {
        let had = self.has(key);
        self.0 |= 1 << key as u8;
        if had { Err(word.error(Problem::Twice)) } else { Ok(()) }
    }

    fn has(&self, key: Key) -> bool {
        self.0 & 1 << key as u8 != 0
    }
}

/// Parses the options after the address; returns the word with the number of values.
pub(super) fn options<'w>(
    settings: &Settings,
    point: &mut PointSettings,
    words: &'w Words,
) -> Result<Option<Word<'w>>, Wrong> {
    let mut seen = Seen::default();
    let (mut count, mut scaled) = (None, None);
    if matches!(point.at, PointAt::Device { .. }) && !point.kind.is_writable() {
        set_write(point, Writing::Never);
    }
    while !words.peek().is_end() {
        let word = words.take();
        let key = match point.at {
            PointAt::Device { .. } => word.keyword(POINT_KEYS, listed!(POINT_KEYS))?,
            PointAt::Local { .. } => word.keyword(LOCAL_KEYS, listed!(LOCAL_KEYS))?,
        };
        seen.once(key, word)?;
        match key {
            Key::Count | Key::Of => count = Some(words.peek()),
            Key::Scale | Key::Offset => scaled = Some(word),
            _ => {}
        }
        check(point, &seen, key, word)?;
        set(settings, point, key, words)?;
    }
    if let Some(word) = scaled {
        check_scale(point.scale, point.value, word)?;
    }
    if let (true, Some(word)) = (point.kind.is_bits(), count)
        && seen.has(Key::As)
    {
        // The count is in values of the type.
        let each = point.value.bits();
        if !point.count.is_multiple_of(each) {
            return Err(word.error(Problem::Points(PointProblem::PartOfValue(each))));
        }
        point.count /= each;
    }
    if let PointAt::Device { read, write, .. } = &mut point.at
        && !seen.has(Key::Read)
    {
        *read = usual_reading(*write);
    }
    Ok(count)
}

/// Checks whether the point can have `key` besides those that it has.
fn check(point: &PointSettings, seen: &Seen, key: Key, word: Word) -> Result<(), Wrong> {
    if matches!(key, Key::Write | Key::Multiple) && !point.kind.is_writable() {
        return Err(word.error(Problem::Points(PointProblem::NotWritable)));
    }
    let is_device = matches!(point.at, PointAt::Device { .. });
    if point.kind.is_bits() && (matches!(key, Key::Bit | Key::Bits) || key == Key::As && !is_device) {
        return Err(word.error(Problem::Points(PointProblem::BitsHaveNoType)));
    }
    let own = seen.has(Key::Count) || seen.has(Key::As);
    if seen.has(Key::Of) && (own || seen.has(Key::Scale) || seen.has(Key::Offset)) {
        return Err(word.error(Problem::Points(PointProblem::ValuesOfAnother)));
    }
    if seen.has(Key::Bit) && seen.has(Key::Bits) {
        return Err(word.error(Problem::Twice));
    }
    if (seen.has(Key::Bit) || seen.has(Key::Bits)) && own {
        return Err(word.error(Problem::Points(PointProblem::BitOfRegister)));
    }
    Ok(())
}

fn set(settings: &Settings, point: &mut PointSettings, key: Key, words: &Words) -> Result<(), Wrong> {
    match key {
        Key::Count => point.count = medium(words.take(), "values", COUNTS)?,
        Key::As => point.value = value_type(words, !point.kind.is_bits())?,
        Key::Bit => {
            let word = words.take();
            let nth = small(word, "a bit of the register", 0..=RegisterBit::ALL.len() as u8 - 1)?;
            point.value = ValueType::Bit;
            if let PointAt::Device { bits, .. } = &mut point.at {
                *bits = RegisterBit::ALL.get(usize::from(nth)).copied().map(RegisterBits::one);
            }
        }
        Key::Bits => {
            let several = long_words::bits(words)?;
            if let PointAt::Device { bits, .. } = &mut point.at {
                *bits = Some(several);
            }
        }
        Key::Scale | Key::Offset => {
            point.scale = long_words::scale(point.scale, key == Key::Scale, words)?;
        }
        Key::Label => point.label = label(words)?,
        Key::Write => {
            let write = writing(words)?;
            set_write(point, write);
        }
        Key::Read => {
            let reading = reading(words.take())?;
            if let PointAt::Device { read, .. } = &mut point.at {
                *read = reading;
            }
        }
        Key::Multiple => {
            if let PointAt::Device { multiple, .. } = &mut point.at {
                *multiple = true;
            }
        }
        Key::Of => show(settings, point, words.take())?,
        Key::Quality => {
            let first = medium(words.take(), "an input register's address", QUALITIES)?;
            if let PointAt::Local { quality, .. } = &mut point.at {
                *quality = Some(first);
            }
        }
        Key::Unit | Key::Order | Key::Check => {}
    }
    Ok(())
}

/// Lets `point` show the variable of the one that `word` names.
fn show(settings: &Settings, point: &mut PointSettings, word: Word) -> Result<(), Wrong> {
    let (index, target) = existing_point(settings, word)?;
    if matches!(target.at, PointAt::Local { of: Some(_), .. }) || target.name == point.name {
        return Err(word.error(Problem::Points(PointProblem::ShowsAnother)));
    }
    match (target.value == ValueType::Bit, point.kind.is_bits()) {
        (true, false) => return Err(word.error(Problem::Points(PointProblem::BitsForNumbers))),
        (false, true) => return Err(word.error(Problem::Points(PointProblem::NumbersForBits))),
        _ => {}
    }
    (point.count, point.value, point.scale) = (target.count, target.value, target.scale);
    if let PointAt::Local { of, .. } = &mut point.at {
        *of = Some(index);
    }
    Ok(())
}

fn set_write(point: &mut PointSettings, new: Writing) {
    if let PointAt::Device { write, .. } = &mut point.at {
        *write = new;
    }
}

/// `auto`, or `every 30s`.
fn writing(words: &Words) -> Result<Writing, Wrong> {
    let word = words.take();
    match long_words::every(word, words) {
        Some(writing) => writing,
        None => word.keyword(WRITINGS, WRITING_EXPECTED),
    }
}

/// `low`, or a period such as `250ms`, in whole milliseconds.
fn reading(word: Word) -> Result<Reading, Wrong> {
    if let Some(reading) = word.lookup(READINGS) {
        return Ok(reading);
    }
    if !word.begins_with_digit() {
        return Err(word.expected("low, normal, high, manual, or a period such as 250ms"));
    }
    whole_ms(word, &PERIOD).map(Reading::Every)
}

/// `"Boiler 2"`, or a single word.
pub(super) fn label(words: &Words) -> Result<Label, Wrong> {
    // An empty label needs quotes.
    let is_missing = words.peek().is_end();
    let word = words.take_quoted();
    let good = !word.text.contains(|character: char| character == '"' || character.is_control());
    let label = if good && !is_missing { Label::try_from(word.text).ok() } else { None };
    label.ok_or_else(|| word.expected("a label of at most 23 bytes, in quotes"))
}

const _: () = assert!(LABEL_BYTES_MAX == 23, "the error text of `label` names the number");
