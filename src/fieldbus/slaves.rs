//! The objects that exist once per Modbus device: configuration, layout and status.
//!
//! All slaves have them from 2100h, 2140h and 2180h on. For the first four, configuration and layout are also at 2001h and 2011h:
//! the same values at two addresses.

use ethercat_subdevice::object::{DataType, Entry, Object};

use crate::scanner::POINTS;

/// Most configurable slaves. The table contains all of them, even in images that cannot poll any.
pub(super) const SLAVES_MAX: usize = 32;
/// Slaves with configuration and layout at two addresses; as many are configured after power-on.
pub(super) const SLAVES_FIRST: u8 = 4;
/// Entries of an array with a value for each slave.
pub(super) const SLAVES: u8 = SLAVES_MAX as u8;
/// The last index of configurations, layouts and status objects.
const CONFIGURATIONS_END: u16 = 0x2100 + SLAVES_MAX as u16 - 1;
const LAYOUTS_END: u16 = 0x2140 + SLAVES_MAX as u16 - 1;
const STATUS_END: u16 = 0x2180 + SLAVES_MAX as u16 - 1;

const _: () = assert!(crate::settings::SLAVES_MAX == if POINTS { SLAVES_MAX } else { 0 });

/// An object of a slave; slaves count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ModbusSlave {
    Configuration(usize),
    Layout(usize),
    Status(usize),
}

impl ModbusSlave {
    /// The object at `index`.
    pub(super) fn of(index: u16) -> Option<Self> {
        Some(match index {
            0x2001..=0x2004 => Self::Configuration(usize::from(index - 0x2001)),
            0x2100..=CONFIGURATIONS_END => Self::Configuration(usize::from(index - 0x2100)),
            0x2011..=0x2014 => Self::Layout(usize::from(index - 0x2011)),
            0x2140..=LAYOUTS_END => Self::Layout(usize::from(index - 0x2140)),
            0x2180..=STATUS_END => Self::Status(usize::from(index - 0x2180)),
            // In a modular gateway.
            0x8000..=0x81f0 if index & 0xf == 0 => Self::Configuration(usize::from(index - 0x8000) >> 4),
            0xa000..=0xa1f0 if index & 0xf == 0 => Self::Status(usize::from(index - 0xa000) >> 4),
            _ => return None,
        })
    }
}

/// The unit id of a slave after power-on.
pub(super) const fn default_unit(nth: u16) -> u8 {
    if nth < SLAVES_FIRST as u16 { nth as u8 + 1 } else { 1 }
}

pub(super) const ANY_U16: (u32, u32) = (0, u16::MAX as u32);

pub(super) const fn configuration(unit: u8) -> [Entry; 10] {
    [
        Entry::setting("Id", DataType::U16, unit as u32, (1, 247)),
        Entry::setting("NumCoils", DataType::U16, 0, ANY_U16),
        Entry::setting("CoilsAddress", DataType::U16, 0, ANY_U16),
        Entry::setting("NumSwitches", DataType::U16, 0, ANY_U16),
        Entry::setting("SwitchesAddress", DataType::U16, 0, ANY_U16),
        Entry::setting("NumInRegisters", DataType::U16, 0, ANY_U16),
        Entry::setting("InRegistersAddress", DataType::U16, 0, ANY_U16),
        Entry::setting("NumOutRegisters", DataType::U16, 0, ANY_U16),
        Entry::setting("OutRegistersAddress", DataType::U16, 0, ANY_U16),
        Entry::setting("PollingTimeMs", DataType::U32, 1_000, (1, 3_600_000)),
    ]
}

const UNIT_1: &[Entry] = &configuration(1);
const UNIT_2: &[Entry] = &configuration(2);
const UNIT_3: &[Entry] = &configuration(3);
const UNIT_4: &[Entry] = &configuration(4);

/// Shared, as they are large and differ only in the default unit id.
const fn configuration_of(nth: u16) -> &'static [Entry] {
    match default_unit(nth) {
        2 => UNIT_2,
        3 => UNIT_3,
        4 => UNIT_4,
        _ => UNIT_1,
    }
}

const LAYOUT: &[Entry] = &[
    Entry::reading("StartInput", DataType::U16),
    Entry::reading("InputCoils", DataType::U16),
    Entry::reading("InputSwitches", DataType::U16),
    Entry::reading("InputInRegisters", DataType::U16),
    Entry::reading("InputOutRegisters", DataType::U16),
    Entry::reading("EndInput", DataType::U16),
    Entry::reading("StartOutput", DataType::U16),
    Entry::reading("OutputCoils", DataType::U16),
    Entry::reading("OutputOutRegisters", DataType::U16),
    Entry::reading("EndOutput", DataType::U16),
];

const fn layout_of(_nth: u16) -> &'static [Entry] {
    LAYOUT
}

/// 0: not polled yet; 1: responds; 2: faulty.
pub(super) const HEALTH: Entry = Entry::input("Health", DataType::U8);

pub(super) const STATUS: &[Entry] = &[
    HEALTH,
    // Never, initially.
    Entry::reading("RespondedBeforeMs", DataType::U32).with_default(u32::MAX),
    Entry::reading("ExceptionCode", DataType::U8),
    Entry::reading("LastError", DataType::U8),
    Entry::reading("Requests", DataType::U32),
    Entry::reading("Responses", DataType::U32),
    Entry::reading("Exceptions", DataType::U32),
    Entry::reading("Failures", DataType::U32),
    // 0: as read; 1: held, 2: cleared, 3: substituted, because the device does not respond.
    Entry::reading("Inputs", DataType::U8),
];

const fn status_of(_nth: u16) -> &'static [Entry] {
    STATUS
}

/// A record for each slave, with its number at the end of the name.
macro_rules! records {
    ($first:literal, $name:literal, $entries:path) => {
        records!(@ $first, $name, $entries;
            0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31)
    };
    (@ $first:literal, $name:literal, $entries:path; $($nth:literal)*) => {
        [$(Object::record($first + $nth, concat!($name, $nth), $entries($nth))),*]
    };
}

pub(super) const CONFIGURATIONS: [Object; SLAVES_MAX] =
    records!(0x2100, "ModbusConfigSlave", configuration_of);
pub(super) const LAYOUTS: [Object; SLAVES_MAX] =
    records!(0x2140, "PhyAddressRegistersModbusSlave", layout_of);
pub(super) const STATUSES: [Object; SLAVES_MAX] = records!(0x2180, "StatusModbusSlave", status_of);

/// The first four of `objects`, at indices from `index` on.
pub(super) const fn first_four(
    objects: &[Object; SLAVES_MAX],
    index: u16,
) -> [Object; SLAVES_FIRST as usize] {
    let [a, b, c, d, ..] = *objects;
    [
        Object { index, ..a },
        Object { index: index + 1, ..b },
        Object { index: index + 2, ..c },
        Object { index: index + 3, ..d },
    ]
}
