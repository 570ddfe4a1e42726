//! The gateway as a modular device (ETG.5001.1), a product distinct from [`DEVICE`]: each Modbus device is a module in a slot, with
//! its own objects and PDOs.
//!
//! Slot n has its settings at 8nn0h, its values at 6nn0h to 6nn3h and 7nn0h to 7nn1h, and its PDOs at 1600h + n and 1A00h + n.

use ethercat_subdevice::application::Address;
use ethercat_subdevice::device::{Device, Identity};
use ethercat_subdevice::object::{Access, DataType, Entries, Entry, Mapped, Object, PADDING, PdoRules, Runs};
use ethercat_subdevice::standard;
use ethercat_subdevice::sync_manager::Channel;

use super::configuration::{ORDERS, TYPES, setting};
use super::modules::{SLOT_STEP, Table, VARIANTS, ident, is_module, pdo_bytes, tables};
use super::objects::{self, BEHIND_STATES, DEVICE, FLAGS, LONG_DEVICE, MODBUS, UART, count, joined};
use super::slaves::{self, ANY_U16, SLAVES};
use crate::scanner::ValueType;
use crate::settings::SlaveSettings;

/// The device's own PDO, after those of the modules.
pub(super) const STATUS_PDO: u16 = 0x1a20;
pub(super) const OWN_BYTES: u32 = 2;
/// Most entries of a PDO: its sub-indices 1 to 254.
pub(super) const PDO_ENTRIES_MAX: usize = 254;

/// The product code of the variant with modules is the next one.
const fn with_modules(identity: Identity) -> Identity {
    Identity { product: identity.product.wrapping_add(1), ..identity }
}

const NAME: &str = "mobgate EtherCAT to Modbus gateway, modular";
const LONG_NAME: &str = "mobgate EtherCAT to Modbus gateway, modular, long images";

/// The gateway as a modular device.
pub const MODULAR: Device =
    Device { identity: IDENTITY, name: NAME, order: "mobgate-modular", objects: OBJECTS, ..DEVICE };

/// The same for a controller with memory for longer images.
pub const LONG_MODULAR: Device = Device {
    identity: LONG_IDENTITY,
    name: LONG_NAME,
    order: "mobgate-modular-long",
    objects: LONG_OBJECTS,
    ..LONG_DEVICE
};

const IDENTITY: Identity = with_modules(DEVICE.identity);
const LONG_IDENTITY: Identity = with_modules(LONG_DEVICE.identity);

const FILLED_UP: Mapped = Mapped { index: PADDING, sub: 0, count: 1, bits: 0 };

/// The identification of a product.
const fn named(name: &'static str, identity: &'static [Entry]) -> [Object; 7] {
    [
        standard::device_type(0x0000_1389),
        standard::device_name(name),
        standard::hardware_version("1"),
        standard::software_version(env!("CARGO_PKG_VERSION")),
        objects::STORE,
        objects::RESTORE,
        standard::identity(identity),
    ]
}

const COMMON: &[Object] = &[standard::ERROR_SETTINGS, standard::DIAGNOSIS_HISTORY, standard::TIME_STAMP];
const PROCESS_DATA: &[Object] = &[
    Object::mapping(
        STATUS_PDO,
        "Status",
        &[Mapped { index: 0x2030, sub: 1, count: 1, bits: 8 }, Mapped { bits: 8, ..FILLED_UP }],
    ),
    standard::SYNC_MANAGER_TYPES,
    standard::rx_assignment(&[], standard::FIXED),
    standard::tx_assignment(&[], standard::FIXED),
    standard::OUTPUT_CLOCKS,
    standard::INPUT_CLOCKS,
    Object::record(0x2000, "ModbusConfig", MODBUS),
    Object::record(0x2005, "ConfigUpdateAndCompletedFlag", FLAGS),
    objects::REASON,
    Object::record(0x2020, "UartConfigUart1", UART),
    Object::record(0x2030, "Status", objects::STATUS),
];

const MODULES: &[Object] = &[
    Object::record(
        0xf000,
        "Modular device profile",
        &[
            Entry::number("Index distance", DataType::U16, SLOT_STEP as u32),
            Entry::number("Maximum number of modules", DataType::U16, SLAVES as u32),
        ],
    ),
    Object::array(
        0xf010,
        "Module profile list",
        SLAVES,
        Entry::number("Profile", DataType::U32, 0x1389).numbered(),
    ),
    // 0 everywhere: the MainDevice does not specify which modules it expects.
    Object::array(
        0xf030,
        "Configured module ident list",
        SLAVES,
        Entry::setting("Module ident", DataType::U32, 0, (0, u32::MAX))
            .with_access(standard::SELECTABLE.and(Access::SETTING))
            .numbered(),
    ),
    Object::array(
        0xf050,
        "Detected module ident list",
        SLAVES,
        Entry::reading("Module ident", DataType::U32).numbered(),
    ),
];

const PARTS: &[&[Object]] =
    &[&named(NAME, &standard::identity_entries(IDENTITY)), COMMON, PROCESS_DATA, BEHIND_STATES, MODULES];
const LONG_PARTS: &[&[Object]] = &[
    &named(LONG_NAME, &standard::identity_entries(LONG_IDENTITY)),
    COMMON,
    PROCESS_DATA,
    BEHIND_STATES,
    MODULES,
];
const OBJECTS: &[Object] = &joined::<{ count(PARTS) }>(PARTS);
const LONG_OBJECTS: &[Object] = &joined::<{ count(LONG_PARTS) }>(LONG_PARTS);

/// 8nn0h: the entries of 2100h + nn, and additional ones.
const SETTINGS: &[Entry] = &{
    let [unit, coils, coil, switches, switch, inputs, input, outputs, output, polling] =
        slaves::configuration(1);
    let mut values = [
        unit,
        coils,
        coil,
        switches,
        switch,
        inputs,
        input,
        outputs,
        output,
        polling,
        Entry::setting("OnSilence", DataType::U8, 0, (0, 2)),
        Entry::setting("Substitute", DataType::U16, 0, ANY_U16),
        Entry::setting("CheckBeforePoll", DataType::U8, 0, (0, 1)),
        Entry::setting("TypeOfInRegisters", DataType::U8, 0, (0, TYPES.len() as u32 - 1)),
        Entry::setting("TypeOfOutRegisters", DataType::U8, 0, (0, TYPES.len() as u32 - 1)),
        Entry::setting("Order", DataType::U8, 0, (0, ORDERS.len() as u32 - 1)),
    ];
    let mut left = values.as_mut_slice();
    while let [entry, behind @ ..] = left {
        // They determine the PDOs, which are fixed from SafeOp on.
        *entry = entry.with_access(standard::SELECTABLE.and(Access::SETTING));
        left = behind;
    }
    values
};

const INFORMATION: &[Entry] = &[
    Entry::reading("Module ident", DataType::U32),
    Entry::reading("Bytes of inputs", DataType::U16),
    Entry::reading("Bytes of outputs", DataType::U16),
];

/// The slot of a module's object or PDO, and the corresponding index in slot 0.
pub(super) fn slot_of(index: u16) -> Option<(usize, u16)> {
    let slots = u16::from(SLAVES);
    let (slot, first) = match index {
        0x1600..=0x161f => (index - 0x1600, 0x1600),
        0x1a00..=0x1a1f => (index - 0x1a00, 0x1a00),
        0x6000..=0xafff => ((index & 0x0fff) / SLOT_STEP, index & 0xf00f),
        _ => return None,
    };
    (slot < slots).then_some((slot.into(), first))
}

/// The index in `slot` that corresponds to `first` in slot 0.
pub(super) const fn in_slot(first: u16, slot: usize) -> u16 {
    let step = if first < 0x6000 { 1 } else { SLOT_STEP };
    first + step * slot as u16
}

/// First index of each object area in slot 0, and its size, in index order.
const AREAS: &[(u16, u16)] =
    &[(0x1600, 1), (0x1a00, 1), (0x6000, 4), (0x7000, 2), (0x8000, 1), (0x9000, 1), (0xa000, 1)];

/// All possible indices of module objects, in order.
pub(super) fn indices() -> impl Iterator<Item = u16> {
    let slots = 0..usize::from(SLAVES);
    AREAS.iter().flat_map(move |&(first, count)| {
        slots.clone().flat_map(move |slot| (first..first + count).map(move |first| in_slot(first, slot)))
    })
}

/// Whether the module `slave` has the object at `first` in slot 0.
pub(super) fn has(slave: &SlaveSettings, first: u16) -> bool {
    match first {
        0x1600 => pdo_bytes(slave, Channel::Outputs) > 0,
        0x6000..=0x6fff => tables(slave, Channel::Inputs).any(|table| table.index == first),
        0x7000..=0x7fff => tables(slave, Channel::Outputs).any(|table| table.index == first),
        _ => true,
    }
}

/// The object of the module `slave` in `slot` that corresponds to `first` in slot 0.
pub(super) fn object(slave: &SlaveSettings, slot: usize, first: u16) -> Option<Object> {
    let channel = if matches!(first, 0x1600 | 0x7000..=0x7fff) { Channel::Outputs } else { Channel::Inputs };
    let (name, entries) = match first {
        0x1600 | 0x1a00 => {
            tables(slave, channel).next()?;
            let name = if channel == Channel::Outputs { "Outputs of module" } else { "Inputs of module" };
            (name, Entries::Mapping(runs(slave, slot, channel)?, PdoRules::NONE))
        }
        0x8000 => ("Settings of module", Entries::Record(SETTINGS)),
        0x9000 => ("Information on module", Entries::Record(INFORMATION)),
        0xa000 => ("Diagnosis of module", Entries::Record(slaves::STATUS)),
        _ => {
            let table = tables(slave, channel).find(|table| table.index == first)?;
            let (name, value) = values_of(&table);
            (name, Entries::Array(u8::try_from(table.values).ok()?, value))
        }
    };
    Some(Object { index: in_slot(first, slot), name, entries })
}

/// The name of a table, and its entries.
fn values_of(table: &Table) -> (&'static str, Entry) {
    let data_type = match table.value_type {
        ValueType::Bit => DataType::Bool,
        ValueType::U16 => DataType::U16,
        ValueType::I16 => DataType::I16,
        ValueType::U32 => DataType::U32,
        ValueType::I32 => DataType::I32,
        ValueType::F32 => DataType::F32,
        ValueType::Long(long) => match long.name() {
            "u64" => DataType::U64,
            "i64" => DataType::I64,
            // Text has no place in an image.
            _ => DataType::F64,
        },
    };
    let (name, entry) = match table.index {
        0x6000 => ("Discrete inputs", Entry::input("Discrete input", data_type)),
        0x6001 => ("Coils read", Entry::input("Coil", data_type)),
        0x6002 => ("Input registers", Entry::input("Input register", data_type)),
        0x6003 => ("Holding registers read", Entry::input("Holding register", data_type)),
        0x7000 => ("Coils", Entry::output("Coil", data_type)),
        _ => ("Holding registers", Entry::output("Holding register", data_type)),
    };
    (name, entry.numbered())
}

/// The content of a module's PDO; `None` if it has too many entries.
fn runs(slave: &SlaveSettings, slot: usize, channel: Channel) -> Option<Runs> {
    let (mut runs, mut entries, mut end) = (Runs::NONE, 0, 0);
    // Padding before the first register and at the end: with bits and registers, six runs at most.
    let mut pad = |runs: Runs, from: u32, to: u32| match to - from {
        0 => Some(runs),
        bits => {
            entries += 1;
            runs.and(Mapped { bits: bits as u8, ..FILLED_UP })
        }
    };
    let mut values = 0;
    for table in tables(slave, channel) {
        runs = pad(runs, end, table.at)?;
        let count = u8::try_from(table.values).ok()?;
        let bits = table.value_type.bits() as u8;
        runs = runs.and(Mapped { index: in_slot(table.index, slot), sub: 1, count, bits })?;
        (values, end) = (values + usize::from(count), table.end());
    }
    runs = pad(runs, end, end.next_multiple_of(u16::BITS))?;
    (values + entries <= PDO_ENTRIES_MAX).then_some(runs)
}

/// Whether a module's PDOs can list all its values.
pub(super) fn fits(slave: &SlaveSettings) -> bool {
    [Channel::Outputs, Channel::Inputs].into_iter().all(|channel| runs(slave, 0, channel).is_some())
}

/// A Modbus device as a module in slot 0, for description files.
#[derive(Debug, Clone, Copy)]
pub struct Module(SlaveSettings);

impl Module {
    /// Number of slots.
    pub const SLOTS: u8 = SLAVES;
    /// Index distance between the objects of adjacent slots.
    pub const INDEX_STEP: u16 = SLOT_STEP;
    /// The bits of an ident that distinguish modules with equal process data.
    pub const VARIANTS: u32 = VARIANTS;

    /// `slave` as a module, if possible.
    pub fn of(slave: &SlaveSettings) -> Option<Self> {
        (is_module(slave) && fits(slave)).then_some(Self(*slave))
    }

    /// The module's device.
    pub fn slave(&self) -> &SlaveSettings {
        &self.0
    }

    /// Distinguishes modules with different process data.
    pub fn ident(&self) -> u32 {
        ident(&self.0)
    }

    /// Its object at `index`.
    pub fn object(&self, index: u16) -> Option<Object> {
        object(&self.0, 0, slot_of(index)?.1)
    }

    /// All its objects except PDOs.
    pub fn objects(&self) -> impl Iterator<Item = Object> {
        let indices = indices().filter(|&index| index >= 0x6000);
        indices
            .filter_map(|index| slot_of(index).filter(|(slot, _)| *slot == 0))
            .filter_map(|(_, first)| has(&self.0, first).then(|| object(&self.0, 0, first)).flatten())
    }

    /// The settings that configure this module.
    pub fn settings(&self) -> impl Iterator<Item = (Address, u32)> {
        (1..=SETTINGS.len() as u8)
            .filter_map(|sub| Some((Address { index: 0x8000, sub }, setting(&self.0, usize::from(sub) - 1)?)))
    }
}
