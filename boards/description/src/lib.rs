//! The ESI file for configuration tools: the gateway's devices, and the modules for the slots of the modular ones.
//!
//! Modules are the slaves of the settings, followed by a catalogue of common ones. Tools tell modules apart by their ident, so a
//! module with the same process data as an earlier one gets another variant of that ident.
#![forbid(unsafe_code)]

use std::fmt::{self, Display, Write};

use ethercat_description::esi::{self, Command, EsiError, Slots};
use ethercat_subdevice::application::Address;
use ethercat_subdevice::device::Device;
use ethercat_subdevice::object::Object;
use mobgate::fieldbus::{LONG_DEVICE, LONG_MODULAR, Module, updatable_device};
use mobgate::scanner::{Kind, ValueType};
use mobgate::settings::{Cells, SlaveSettings};

const CLASS: &str = "Modbus";
const SLOTS: Slots = Slots {
    name: "Modbus device",
    class: CLASS,
    count: Module::SLOTS,
    index_step: Module::INDEX_STEP,
    pdo_step: 1,
    // Enables all slots; one without values counts as empty.
    start_up: &[Command { at: Address { index: 0x2000, sub: 1 }, value: Module::SLOTS as u64 }],
};

/// Bits, and values in registers, of the catalogue's modules.
const BITS: [u16; 4] = [8, 16, 32, 64];
const VALUES: [u16; 6] = [1, 2, 4, 8, 16, 32];
/// The tables in PDO order.
const TABLES: [Kind; 4] = [Kind::Discrete, Kind::Coil, Kind::Input, Kind::Holding];

/// Writes the gateway's ESI file: a module for each of `slaves`, then the common ones. Devices with long images have EoE if the
/// settings offer `ethernet`.
///
/// # Errors
/// If a description does not fit an EEPROM, or `into` cannot be written.
pub fn write_esi(slaves: &[SlaveSettings], ethernet: bool, into: &mut impl Write) -> Result<(), EsiError> {
    let modular = Some(SLOTS);
    let [fixed, modules_in_slots] = [false, true].map(updatable_device);
    let [long, long_modular] = [LONG_DEVICE, LONG_MODULAR].map(|device| Device { ethernet, ..device });
    let devices = [(fixed, None), (&long, None), (modules_in_slots, modular), (&long_modular, modular)];
    esi::write_file(&devices, &modules(slaves), into)
}

/// The slaves of the settings that can be modules, then the common ones.
fn modules(slaves: &[SlaveSettings]) -> Vec<ModbusModule> {
    let set = slaves.iter().enumerate().map(|(nth, slave)| (*slave, Some(nth)));
    let common = catalogue().into_iter().map(|slave| (slave, None));
    let mut modules: Vec<ModbusModule> = Vec::new();
    for (slave, nth) in set.chain(common) {
        let Some(module) = Module::of(&slave) else { continue };
        let before = modules.iter().filter(|other| other.module.ident() == module.ident()).count();
        let ident = module.ident() | before as u32 & Module::VARIANTS;
        modules.push(ModbusModule { module, nth, ident });
    }
    modules
}

fn catalogue() -> Vec<SlaveSettings> {
    let of = |kind: Kind, count: u16, value_type: ValueType| {
        let mut slave = SlaveSettings::new(1);
        let cells = slave.cells.iter_mut().zip(Kind::ALL);
        cells.filter(|(_, of)| *of == kind).for_each(|(cells, _)| *cells = Cells { count, address: 0 });
        SlaveSettings { types: [value_type; 2], ..slave }
    };
    let mut common = Vec::new();
    for kind in [Kind::Discrete, Kind::Coil] {
        common.extend(BITS.map(|count| of(kind, count, ValueType::U16)));
    }
    for kind in [Kind::Input, Kind::Holding] {
        for value_type in ValueType::NUMBERS.iter().copied() {
            common.extend(VALUES.map(|values| of(kind, values * value_type.registers(), value_type)));
        }
    }
    common
}

/// A module in the ESI file.
struct ModbusModule {
    module: Module,
    /// Index of the slave in the settings; `None` for the catalogue's.
    nth: Option<usize>,
    ident: u32,
}

impl esi::Module for ModbusModule {
    fn ident(&self) -> u32 {
        self.ident
    }

    fn class(&self) -> &'static str {
        CLASS
    }

    fn name(&self) -> impl Display {
        self
    }

    fn object(&self, index: u16) -> Option<Object> {
        self.module.object(index)
    }

    fn objects(&self) -> impl Iterator<Item = Object> {
        self.module.objects()
    }

    fn start_up(&self) -> impl Iterator<Item = Command> {
        self.module.settings().map(|(at, value)| Command { at, value: value.into() })
    }
}

impl Display for ModbusModule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let slave = self.module.slave();
        if let Some(nth) = self.nth {
            write!(f, "Slave {nth}, unit {}: ", slave.unit)?;
        }
        let mut between = "";
        for kind in TABLES {
            let cells = slave.tables().find_map(|(of, cells)| (of == kind).then_some(cells.count));
            let value_type = slave.value_type(kind);
            let values = cells.unwrap_or_default() / value_type.registers();
            match value_type {
                _ if values == 0 => continue,
                ValueType::Bit if kind == Kind::Coil => write!(f, "{between}{values} coils")?,
                ValueType::Bit => write!(f, "{between}{values} discrete inputs")?,
                value_type => write!(f, "{between}{values} {} in {kind} registers", iec(value_type))?,
            }
            between = ", ";
        }
        Ok(())
    }
}

/// The name of a type in IEC 61131-3.
fn iec(value_type: ValueType) -> &'static str {
    match value_type {
        ValueType::Bit => "BOOL",
        ValueType::U16 => "UINT",
        ValueType::I16 => "INT",
        ValueType::U32 => "UDINT",
        ValueType::I32 => "DINT",
        ValueType::F32 => "REAL",
        ValueType::Long(long) => long.iec(),
    }
}
