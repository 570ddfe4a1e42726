//! The lines of data points: `device meter unit 5 order 2301`, `point power meter holding 0 count 2 as f32 read high`.
//!
//! An address follows the name of its table as on the wire (`holding 0`), or stands alone in Modicon notation (`40001`), so
//! numbers are unambiguous.

use heapless::String;

use super::changed::Changed;
use super::listed::keywords;
use super::long_words::{TYPES, lacking};
use super::point_checks::check_others;
use super::point_options::{self, DEVICE_KEYS, Key, Seen, UNITS, label, options};
use super::point_problem::PointProblem;
use super::points::usual_type;
use super::problem::Problem;
use super::values::{is_name, medium, parse_number, small};
use super::words::{Word, Words, Wrong};
use crate::scanner::{ByteOrder, Device, Kind, Modicon, Reading, Scale, Writing};
use crate::settings::{DeviceSettings, Label, PointAt, PointName, PointSettings, Port, PortKind, Settings};

keywords!(pub(crate) KINDS: Kind {
    "coil": Coil, "discrete": Discrete, "input": Input, "holding": Holding
});

keywords!(pub(crate) ORDERS: ByteOrder {
    "0123": Order0123, "2301": Order2301, "1032": Order1032, "3210": Order3210
});

pub(crate) const ORDERS_EXPECTED: &str = "0123, 2301, 1032 or 3210";

/// Calls `each` with the keywords of these lines.
pub(crate) fn keywords(each: &mut dyn FnMut(&'static str)) {
    point_options::keywords(each);
    KINDS.iter().for_each(|&(keyword, _)| each(keyword));
    TYPES.iter().for_each(|&(keyword, _)| each(keyword));
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
    parse_point(settings, words).map_err(|Wrong| lacking(words))
}

fn parse_point(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
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
        scale: Scale::NONE,
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
    Ok(PointAt::Device { device, read: Reading::Normal, write: Writing::Manual, multiple: false, bits: None })
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

fn name(word: Word, expected: &'static str) -> Result<PointName, Wrong> {
    let name = if is_name(word) { String::try_from(word.text).ok() } else { None };
    name.ok_or_else(|| word.expected(expected))
}
