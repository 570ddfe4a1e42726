//! The Modbus devices behind the EtherCAT process image: `slave 0 unit 232 coil 10 count 18 holding 40010 count 4 as f32 read 1s`.
//!
//! They are in the order of their values in the image. A MainDevice that has a configuration taken over changes them as these
//! lines do.

use core::fmt::{self, Display};

use embassy_time::Duration;

use super::point_problem::PointProblem;
use super::point_words::{ORDERS, ORDERS_EXPECTED, PERIOD, TYPES, TYPES_EXPECTED, whole_ms};
use super::print::option;
use super::problem::Problem;
use super::text::Changed;
use super::values::{Time, medium, number, small};
use super::words::{Word, Words, Wrong};
use super::{PortKind, Settings};
use crate::scanner::{ByteOrder, Form, Kind, POINTS, ValueType};

/// Devices behind the process image.
pub const SLAVES_MAX: usize = if POINTS { 32 } else { 0 };
/// How often a device is read if nothing else is said.
const POLLING_MS: u32 = 1_000;

/// Neighbouring cells of one table of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Cells {
    /// How many.
    pub count: u16,
    /// The first one's address on the wire.
    pub address: u16,
}

/// What the inputs of a device become when it does not answer any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum OnSilence {
    /// They stay as they were read last.
    #[default]
    Hold = 0,
    /// All become 0.
    Clear = 1,
    /// Each register becomes [`SlaveSettings::substitute`], and each bit its lowest one.
    Substitute = 2,
}

impl OnSilence {
    /// What then stands in the inputs, behind a comma.
    pub const fn of_inputs(self) -> &'static str {
        match self {
            Self::Hold => ", inputs held",
            Self::Clear => ", inputs cleared",
            Self::Substitute => ", inputs substituted",
        }
    }
}

/// One device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlaveSettings {
    /// Its unit id.
    pub unit: u8,
    /// It is asked for a sign of life before each poll.
    pub check: bool,
    /// What its inputs become when it does not answer any more.
    pub on_silence: OnSilence,
    /// What they become when they are substituted.
    pub substitute: u16,
    /// How often it is read.
    pub polling_ms: u32,
    /// Its cells, in the order of [`Kind::ALL`].
    pub cells: [Cells; 4],
    /// What its input registers and its holding registers are.
    pub types: [ValueType; 2],
    /// In which order it has the bytes of values of 32 bits.
    pub order: ByteOrder,
}

impl SlaveSettings {
    /// The device `unit` without cells.
    pub const fn new(unit: u8) -> Self {
        let cells = [Cells { count: 0, address: 0 }; 4];
        let on_silence = OnSilence::Hold;
        let (types, order) = ([ValueType::U16; 2], ByteOrder::Order0123);
        Self { unit, check: false, on_silence, substitute: 0, polling_ms: POLLING_MS, cells, types, order }
    }

    /// What the cells of a table are.
    pub const fn value_type(&self, kind: Kind) -> ValueType {
        let [input, holding] = self.types;
        match kind {
            Kind::Coil | Kind::Discrete => ValueType::Bit,
            Kind::Input => input,
            Kind::Holding => holding,
        }
    }

    /// How they are kept: values of 32 bits with the high byte first.
    pub const fn form(&self, kind: Kind) -> Form {
        if self.value_type(kind).registers() == 2 { Form::Wide } else { Form::Cells }
    }

    /// The tables with what is configured of them.
    pub fn tables(&self) -> impl Iterator<Item = (Kind, Cells)> {
        Kind::ALL.into_iter().zip(self.cells)
    }

    /// What its inputs are filled with when it does not answer any more.
    pub const fn filling(&self) -> Option<u16> {
        match self.on_silence {
            OnSilence::Hold => None,
            OnSilence::Clear => Some(0),
            OnSilence::Substitute => Some(self.substitute),
        }
    }
}

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

/// Gives `each` the words of these lines that no other line has.
pub(super) fn keywords(each: &mut dyn FnMut(&'static str)) {
    ["on-silence", "substitute"].into_iter().for_each(each);
}

/// Reads a device up to the end of the line, and puts it into the settings.
pub(super) fn slave(settings: &mut Settings, words: &Words) -> Result<Changed, Wrong> {
    let word = words.take();
    if !settings.ports.iter().flatten().any(|port| matches!(port.kind, PortKind::Ethercat(_))) {
        return Err(word.error(Problem::Points(PointProblem::NoEthercat)));
    }
    // One more than there are: it comes behind the others.
    let most = settings.slaves.len().min(SLAVES_MAX.saturating_sub(1));
    let place = number(word, "the next slave's number, or that of one there is,", 0..=most as u32)?;
    words.take().keyword(&[("unit", ())], "unit and the slave's unit id")?;
    let mut slave = SlaveSettings::new(small(words.take(), "a unit id", 1..=247)?);
    let mut seen = heapless::Vec::<Key, 8>::new();
    while !words.peek().is_end() {
        let word = words.take();
        let key = word.keyword(KEYS, EXPECTED)?;
        // There are eight, and none comes twice.
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
    match settings.slaves.get_mut(place as usize) {
        Some(old) => *old = slave,
        // The number was checked.
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
        let value_type = match kind {
            Kind::Coil | Kind::Discrete => {
                return Err(word.error(Problem::Points(PointProblem::BitsHaveNoType)));
            }
            Kind::Input => input,
            Kind::Holding => holding,
        };
        *value_type = words.take().keyword(TYPES, TYPES_EXPECTED)?;
        count = count.saturating_mul(value_type.registers());
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

/// Takes the device of this number away; those behind it move up.
pub(super) fn delete_slave(settings: &mut Settings, word: Word) -> Result<Changed, Wrong> {
    let count = settings.slaves.len();
    let Some(last) = count.checked_sub(1) else {
        return Err(word.error(Problem::Points(PointProblem::NoSlaves)));
    };
    let place = number(word, "a slave's number", 0..=last as u32)?;
    settings.slaves.remove(place as usize);
    Ok(Changed::Other)
}

/// The words behind the number.
impl Display for SlaveSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unit {}", self.unit)?;
        for (kind, Cells { count, address }) in self.tables().filter(|(_, cells)| cells.count > 0) {
            let value_type = self.value_type(kind);
            let values = count / value_type.registers();
            write!(f, " {kind} {address}")?;
            option(f, "count", values, values != 1)?;
            option(f, "as", value_type.name(), !matches!(value_type, ValueType::Bit | ValueType::U16))?;
        }
        option(f, "order", self.order, self.order != ByteOrder::default())?;
        let polling = Duration::from_millis(self.polling_ms.into());
        option(f, "read", Time(polling), self.polling_ms != POLLING_MS)?;
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
