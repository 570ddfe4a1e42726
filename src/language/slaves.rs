//! The Modbus devices of the EtherCAT process image: `slave 0 unit 232 coil 10 count 18 holding 40010 count 4 as f32 read 1s`.
//!
//! Their order is that of their values in the image. A MainDevice's configuration changes the same settings.

use core::fmt::{self, Display};
use core::ops::RangeInclusive;

use embassy_time::Duration;

use super::changed::Changed;
use super::long_words::{lacking, value_type};
use super::option::option;
use super::point_problem::PointProblem;
use super::point_words::{ORDERS, ORDERS_EXPECTED};
use super::problem::Problem;
#[cfg(feature = "web")] // As what uses it.
use super::shape::Shape;
use super::values::{PERIOD, medium, number, small, whole_ms};
use super::words::{Word, Words, Wrong};
use crate::scanner::{ByteOrder, Kind, ValueType};
use crate::settings::{Cells, OnSilence, POLLING_MS, PortKind, SLAVES_MAX, Settings, SlaveSettings, Time};

#[derive(Clone, Copy, PartialEq, Eq)]
enum Key {
    Table(Kind),
    Order,
    Read,
    Check,
    OnSilence,
}

const KEYS: &[(&str, Key)] = &[
    ("coil", Key::Table(Kind::Coil)),
    ("discrete", Key::Table(Kind::Discrete)),
    ("input", Key::Table(Kind::Input)),
    ("holding", Key::Table(Kind::Holding)),
    ("order", Key::Order),
    ("read", Key::Read),
    ("check", Key::Check),
    ("on-silence", Key::OnSilence),
];

const EXPECTED: &str = "coil, discrete, input, holding, order, read, check or on-silence";

const ON_SILENCE: &[(&str, OnSilence)] =
    &[("hold", OnSilence::Hold), ("clear", OnSilence::Clear), ("substitute", OnSilence::Substitute)];

const UNITS: RangeInclusive<u8> = 1..=247;

/// Calls `each` with the keywords that only these lines use.
pub(crate) fn keywords(each: &mut dyn FnMut(&'static str)) {
    ["on-silence", "substitute"].into_iter().for_each(each);
}

/// Calls `each` with the keywords of the line and their types.
// Only the web interface has settings by name.
#[cfg(feature = "web")]
pub(crate) fn members(each: &mut dyn FnMut(&'static str, Shape)) {
    each("unit", Shape::number(UNITS));
    for &(keyword, key) in KEYS {
        each(keyword, if key == Key::Check { Shape::Flag } else { Shape::Text });
    }
}

/// Parses a device up to the end of the line, and stores it.
pub(crate) fn slave(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
    parse_slave(settings, words).map_err(|Wrong| lacking(words))
}

fn parse_slave(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
    let word = words.take();
    if !settings.ports.iter().flatten().any(|port| matches!(port.kind, PortKind::Ethercat(_))) {
        return Err(word.error(Problem::Points(PointProblem::NoEthercat)));
    }
    // The number of slaves means a new one, at the end.
    let most = settings.slaves.len().min(SLAVES_MAX.saturating_sub(1));
    let index = number(word, "the next slave's number, or that of one there is,", 0..=most as u32)?;
    words.take().keyword(&[("unit", ())], "unit and the slave's unit id")?;
    let mut slave = SlaveSettings::new(small(words.take(), "a unit id", UNITS)?);
    let mut seen = heapless::Vec::<Key, 8>::new();
    while !words.peek().is_end() {
        let word = words.take();
        let key = word.keyword(KEYS, EXPECTED)?;
        // There are eight keys, and none is repeated.
        if seen.contains(&key) || seen.push(key).is_err() {
            return Err(word.error(Problem::Twice));
        }
        match key {
            Key::Table(kind) => table(&mut slave, kind, words)?,
            Key::Order => slave.order = words.take().keyword(ORDERS, ORDERS_EXPECTED)?,
            Key::Read => slave.polling_ms = whole_ms(words.take(), &PERIOD)?,
            Key::Check => slave.check = true,
            Key::OnSilence => on_silence(&mut slave, words)?,
        }
    }
    match settings.slaves.get_mut(index as usize) {
        Some(old) => *old = slave,
        // Within the capacity: the number was checked.
        None => drop(settings.slaves.push(slave)),
    }
    Ok(Changed::Other)
}

/// `10 count 18 as f32`
fn table(slave: &mut SlaveSettings, kind: Kind, words: &Words) -> Result<(), Wrong> {
    let first = words.take();
    let address = medium(first, "an address as it is on the wire", 0..=u16::MAX)?;
    let mut count = 1;
    if words.peek().is("count") {
        words.take();
        count = medium(words.take(), "cells", 1..=u16::MAX)?;
    }
    if words.peek().is("as") {
        let word = words.take();
        let [input, holding] = &mut slave.types;
        let target = match kind {
            Kind::Coil | Kind::Discrete => {
                return Err(word.error(Problem::Points(PointProblem::BitsHaveNoType)));
            }
            Kind::Input => input,
            Kind::Holding => holding,
        };
        *target = value_type(words, false)?;
        count = count.saturating_mul(target.registers());
    }
    if u32::from(address) + u32::from(count) > 65_536 {
        return Err(first.error(Problem::Points(PointProblem::AddressesEnd)));
    }
    if let Some((_, cells)) = Kind::ALL.into_iter().zip(&mut slave.cells).find(|(other, _)| *other == kind) {
        *cells = Cells { count, address };
    }
    Ok(())
}

/// `hold`, `clear` or `substitute 17`
fn on_silence(slave: &mut SlaveSettings, words: &Words) -> Result<(), Wrong> {
    slave.on_silence = words.take().keyword(ON_SILENCE, "hold, clear or substitute")?;
    if slave.on_silence == OnSilence::Substitute {
        slave.substitute = medium(words.take(), "a register's value", 0..=u16::MAX)?;
    }
    Ok(())
}

/// Deletes the device with this number; those after it move up.
pub(crate) fn delete_slave(settings: &mut Settings, word: Word) -> Result<Changed, Wrong> {
    let count = settings.slaves.len();
    let Some(last) = count.checked_sub(1) else {
        return Err(word.error(Problem::Points(PointProblem::NoSlaves)));
    };
    let index = number(word, "a slave's number", 0..=last as u32)?;
    settings.slaves.remove(index as usize);
    Ok(Changed::Other)
}

/// The words after the number.
impl Display for SlaveSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unit {}", self.unit)?;
        for (kind, Cells { count, address }) in self.tables().filter(|(_, cells)| cells.count > 0) {
            let value_type = self.value_type(kind);
            let values = count / value_type.registers();
            write!(f, " {kind} {address}")?;
            option(f, "count", &values, values != 1)?;
            option(f, "as", &value_type.name(), !matches!(value_type, ValueType::Bit | ValueType::U16))?;
        }
        option(f, "order", &self.order, self.order != ByteOrder::default())?;
        let polling = Duration::from_millis(self.polling_ms.into());
        option(f, "read", &Time(polling), self.polling_ms != POLLING_MS)?;
        if self.check {
            f.write_str(" check")?;
        }
        match self.on_silence {
            OnSilence::Hold => Ok(()),
            OnSilence::Clear => f.write_str(" on-silence clear"),
            OnSilence::Substitute => write!(f, " on-silence substitute {}", self.substitute),
        }
    }
}
