//! The lines of data points: `device meter unit 5 order 2301`, `point power meter holding 0 count 2 as f32 read high`.
//!
//! An address follows the name of its table as on the wire (`holding 0`), or stands alone in Modicon notation (`40001`), so
//! numbers are unambiguous.

use core::ops::RangeInclusive;

use embassy_time::Duration;
use heapless::String;

use super::changed::Changed;
use super::listed::keywords;
use super::point_checks::{check_others, existing_point};
use super::point_problem::PointProblem;
use super::points::{usual_reading, usual_type};
use super::problem::Problem;
#[cfg(feature = "web")] // As what uses it.
use super::shape::Shape;
use super::values::{is_name, medium, parse_number, small, time};
use super::words::{Word, Words, Wrong};
use crate::scanner::{ByteOrder, Device, Kind, Modicon, Reading, RegisterBit, ValueType, Writing};
use crate::settings::{
    DeviceSettings, LABEL_BYTES_MAX, Label, PointAt, PointName, PointSettings, Port, PortKind, Settings,
};

pub(crate) const PERIOD: RangeInclusive<Duration> = Duration::from_millis(1)..=Duration::from_secs(3_600);

/// Limits of these lines' numbers.
const UNITS: RangeInclusive<u8> = 1..=255;
const COUNTS: RangeInclusive<u16> = 1..=1_968;
const QUALITIES: RangeInclusive<u16> = 0..=u16::MAX - 1;

keywords!(pub(crate) KINDS: Kind {
    "coil": Coil, "discrete": Discrete, "input": Input, "holding": Holding
});

keywords!(pub(crate) ORDERS: ByteOrder {
    "0123": Order0123, "2301": Order2301, "1032": Order1032, "3210": Order3210
});

pub(crate) const ORDERS_EXPECTED: &str = "0123, 2301, 1032 or 3210";

pub(crate) const TYPES: &[(&str, ValueType)] = &[
    ("u16", ValueType::U16),
    ("i16", ValueType::I16),
    ("u32", ValueType::U32),
    ("i32", ValueType::I32),
    ("f32", ValueType::F32),
];

pub(crate) const TYPES_EXPECTED: &str = "u16, i16, u32, i32 or f32";

const READINGS: &[(&str, Reading)] = &[
    ("low", Reading::Low),
    ("normal", Reading::Normal),
    ("high", Reading::High),
    ("manual", Reading::Manual),
];

const WRITINGS: &[(&str, Writing)] =
    &[("auto", Writing::Auto), ("change", Writing::OnChange), ("manual", Writing::Manual)];

#[derive(Clone, Copy, PartialEq, Eq)]
enum Key {
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
}

const DEVICE_KEYS: &[(&str, Key)] =
    &[("unit", Key::Unit), ("order", Key::Order), ("check", Key::Check), ("label", Key::Label)];

const POINT_KEYS: &[(&str, Key)] = &[
    ("count", Key::Count),
    ("as", Key::As),
    ("bit", Key::Bit),
    ("read", Key::Read),
    ("write", Key::Write),
    ("multiple", Key::Multiple),
    ("label", Key::Label),
];

const LOCAL_KEYS: &[(&str, Key)] = &[
    ("count", Key::Count),
    ("as", Key::As),
    ("of", Key::Of),
    ("quality", Key::Quality),
    ("label", Key::Label),
];

/// Calls `each` with the keywords of these lines.
pub(crate) fn keywords(each: &mut dyn FnMut(&'static str)) {
    DEVICE_KEYS.iter().for_each(|&(keyword, _)| each(keyword));
    // `label` is one keyword, though several lines have it.
    let others = POINT_KEYS.iter().filter(|(_, key)| *key != Key::Label);
    others.for_each(|&(keyword, _)| each(keyword));
    ["of", "quality"].into_iter().for_each(&mut *each);
    KINDS.iter().for_each(|&(keyword, _)| each(keyword));
    TYPES.iter().for_each(|&(keyword, _)| each(keyword));
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
        };
        each(keyword, shape);
    }
}

/// The keywords a line has had so far.
#[derive(Default)]
struct Seen(u16);

impl Seen {
    fn once(&mut self, key: Key, word: Word) -> Result<(), Wrong> {
        let had = self.has(key);
        self.0 |= 1 << key as u8;
        if had { Err(word.error(Problem::Twice)) } else { Ok(()) }
    }

    fn has(&self, key: Key) -> bool {
        self.0 & 1 << key as u8 != 0
    }
}

/// Parses a device up to the end of the line, and stores it.
pub(crate) fn device(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
    let name_word = words.take();
    let name = name(name_word, "a name for the device, as for a port")?;
    let scanner = |port: &Port| port.kind == PortKind::Scanner;
    if !settings.ports.iter().flatten().any(scanner) {
        return Err(name_word.error(Problem::Points(PointProblem::NoScanner)));
    }
    words.take().keyword(&[("unit", ())], "unit and the device's unit id")?;
    let unit = small(words.take(), "a unit id", UNITS)?;
    let mut device = Device { unit, order: ByteOrder::default(), check: false, filling: None };
    let mut device_label = Label::new();
    let mut seen = Seen::default();
    seen.once(Key::Unit, name_word)?;
    while !words.peek().is_end() {
        let word = words.take();
        let key = word.keyword(DEVICE_KEYS, "order, check or label")?;
        seen.once(key, word)?;
        match key {
            Key::Order => device.order = words.take().keyword(ORDERS, ORDERS_EXPECTED)?,
            Key::Check => device.check = true,
            _ => device_label = label(words)?,
        }
    }
    let index = settings.find_device(&name).map(usize::from);
    let new = DeviceSettings { name, device, label: device_label };
    match index.and_then(|index| settings.devices.get_mut(index)) {
        Some(old) => *old = new,
        None => settings
            .devices
            .push(new)
            .map_err(|_| name_word.error(Problem::Points(PointProblem::DevicesFull)))?,
    }
    Ok(Changed::Other)
}

/// Parses a point up to the end of the line, checks it against the others, and stores it.
pub(crate) fn point(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
    let name_word = words.take();
    let name = name(name_word, "a name for the point, as for a port")?;
    let device = at(settings, words.take())?;
    let address_word = words.peek();
    let (kind, first) = address(words)?;
    let mut point = PointSettings {
        name,
        at: device,
        kind,
        first,
        count: 1,
        value: usual_type(kind),
        label: Label::new(),
    };
    let count_word = options(settings, &mut point, words)?.unwrap_or(address_word);
    // A row must fit one frame, for reading and for writing.
    let most = kind.cells_max(kind.is_writable())
        / if kind.is_bits() { point.value.bits() } else { point.value.registers() };
    if !(1..=most).contains(&point.count) {
        let problem = Problem::Number { what: "values in a frame", low: 1, high: most.into() };
        return Err(count_word.error(problem));
    }
    if u32::from(first) + u32::from(point.cells()) > 65_536 {
        return Err(address_word.error(Problem::Points(PointProblem::AddressesEnd)));
    }
    let index = settings.find_point(&point.name).map(usize::from);
    check_others(settings, &point, index, name_word, address_word)?;
    match index.and_then(|index| settings.points.get_mut(index)) {
        Some(old) => *old = point,
        None => settings
            .points
            .push(point)
            .map_err(|_| name_word.error(Problem::Points(PointProblem::PointsFull)))?,
    }
    Ok(Changed::Other)
}

/// Where a point is: `local`, or the name of a device.
fn at(settings: &Settings, word: Word) -> Result<PointAt, Wrong> {
    if word.is_end() {
        return Err(word.expected("the name of a device, or local"));
    }
    if word.is("local") {
        return Ok(PointAt::Local { of: None, quality: None });
    }
    let device = settings
        .find_device(word.text)
        .ok_or_else(|| word.error(Problem::Points(PointProblem::NoSuchDevice)))?;
    Ok(PointAt::Device { device, read: Reading::Normal, write: Writing::Manual, multiple: false, bit: None })
}

/// `holding 0`, or `40001`.
fn address(words: &Words) -> Result<(Kind, u16), Wrong> {
    let word = words.take();
    if let Some(number) = parse_number(word.text) {
        let Modicon(kind, first) = Modicon::parse(number)
            .ok_or_else(|| word.expected("coil, discrete, input or holding, or a number such as 40001"))?;
        return Ok((kind, first));
    }
    let kind = word.keyword(KINDS, "coil, discrete, input or holding, or a number such as 40001")?;
    Ok((kind, medium(words.take(), "an address as it is on the wire", 0..=u16::MAX)?))
}

/// Parses the options after the address; returns the word with the number of values.
fn options<'w>(
    settings: &Settings,
    point: &mut PointSettings,
    words: &'w Words,
) -> Result<Option<Word<'w>>, Wrong> {
    let mut seen = Seen::default();
    let mut count = None;
    if matches!(point.at, PointAt::Device { .. }) && !point.kind.is_writable() {
        set_write(point, Writing::Never);
    }
    while !words.peek().is_end() {
        let word = words.take();
        let key = match point.at {
            PointAt::Device { .. } => {
                word.keyword(POINT_KEYS, "count, as, bit, read, write, multiple or label")?
            }
            PointAt::Local { .. } => word.keyword(LOCAL_KEYS, "count, as, of, quality or label")?,
        };
        seen.once(key, word)?;
        if matches!(key, Key::Count | Key::Of) {
            count = Some(words.peek());
        }
        if matches!(key, Key::Write | Key::Multiple) && !point.kind.is_writable() {
            return Err(word.error(Problem::Points(PointProblem::NotWritable)));
        }
        let is_device = matches!(point.at, PointAt::Device { .. });
        if point.kind.is_bits() && (key == Key::Bit || key == Key::As && !is_device) {
            return Err(word.error(Problem::Points(PointProblem::BitsHaveNoType)));
        }
        let own = seen.has(Key::Count) || seen.has(Key::As);
        if seen.has(Key::Of) && own {
            return Err(word.error(Problem::Points(PointProblem::ValuesOfAnother)));
        }
        if seen.has(Key::Bit) && own {
            return Err(word.error(Problem::Points(PointProblem::BitOfRegister)));
        }
        set(settings, point, key, words)?;
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

fn set(settings: &Settings, point: &mut PointSettings, key: Key, words: &Words) -> Result<(), Wrong> {
    match key {
        Key::Count => point.count = medium(words.take(), "values", COUNTS)?,
        Key::As => point.value = words.take().keyword(TYPES, TYPES_EXPECTED)?,
        Key::Bit => {
            let word = words.take();
            let nth = small(word, "a bit of the register", 0..=RegisterBit::ALL.len() as u8 - 1)?;
            point.value = ValueType::Bit;
            if let PointAt::Device { bit, .. } = &mut point.at {
                *bit = RegisterBit::ALL.get(usize::from(nth)).copied();
            }
        }
        Key::Label => point.label = label(words)?,
        Key::Write => {
            let write = words.take().keyword(WRITINGS, "auto, change or manual")?;
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
        Key::Of => {
            let word = words.take();
            let (index, target) = existing_point(settings, word)?;
            if matches!(target.at, PointAt::Local { of: Some(_), .. }) || target.name == point.name {
                return Err(word.error(Problem::Points(PointProblem::ShowsAnother)));
            }
            match (target.value == ValueType::Bit, point.kind.is_bits()) {
                (true, false) => return Err(word.error(Problem::Points(PointProblem::BitsForNumbers))),
                (false, true) => return Err(word.error(Problem::Points(PointProblem::NumbersForBits))),
                _ => {}
            }
            (point.count, point.value) = (target.count, target.value);
            if let PointAt::Local { of, .. } = &mut point.at {
                *of = Some(index);
            }
        }
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

fn set_write(point: &mut PointSettings, new: Writing) {
    if let PointAt::Device { write, .. } = &mut point.at {
        *write = new;
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

/// A time in whole milliseconds.
pub(crate) fn whole_ms(word: Word, range: &RangeInclusive<Duration>) -> Result<u32, Wrong> {
    let period = time(word, range)?;
    let whole = u32::try_from(period.as_millis()).ok();
    let whole = whole.filter(|ms| Duration::from_millis((*ms).into()) == period);
    whole.ok_or_else(|| word.expected("whole milliseconds"))
}

fn name(word: Word, expected: &'static str) -> Result<PointName, Wrong> {
    let name = if is_name(word) { String::try_from(word.text).ok() } else { None };
    name.ok_or_else(|| word.expected(expected))
}

/// `"Boiler 2"`, or a single word.
fn label(words: &Words) -> Result<Label, Wrong> {
    // An empty label needs quotes.
    let is_missing = words.peek().is_end();
    let word = words.take_quoted();
    let good = !word.text.contains(|character: char| character == '"' || character.is_control());
    let label = if good && !is_missing { Label::try_from(word.text).ok() } else { None };
    label.ok_or_else(|| word.expected("a label of at most 23 bytes, in quotes"))
}

const _: () = assert!(LABEL_BYTES_MAX == 23, "the error text of `label` names the number");
