//! The gateway for configuration tools: its devices, and the modules that can be put into the slots of the modular one.
//!
//! Those are the slaves of the settings, and a catalogue of common ones. A tool tells modules apart by their ident, so what has the same
//! process data as one before it has another variant of that.

use core::fmt::{self, Display, Write};

use ethercat_subdevice::application::Address;
use ethercat_subdevice::esi::{self, Command, EsiError, Module, Slots};
use ethercat_subdevice::object::Object;
use ethercat_subdevice::sync_manager::Channel;

use super::configuration::{TYPES, setting};
use super::modular::{self, SETTINGS_ENTRIES};
use super::modules::{SLOT_STEP, VARIANTS, ident, tables};
use super::slaves::SLAVES;
use super::{DEVICE, LONG_DEVICE, LONG_MODULAR, MODULAR};
use crate::scanner::{Kind, ValueType};
use crate::settings::{Cells, SlaveSettings};

const CLASS: &str = "Modbus";
const SLOTS: Slots = Slots {
    name: "Modbus device",
    class: CLASS,
    count: SLAVES,
    index_step: SLOT_STEP,
    pdo_step: 1,
    // A slot without values is empty.
    start_up: &[Command { at: Address { index: 0x2000, sub: 1 }, value: SLAVES as u64 }],
};

/// How many bits, and how many values in registers, modules of the catalogue have.
const BITS: [u16; 4] = [8, 16, 32, 64];
const VALUES: [u16; 6] = [1, 2, 4, 8, 16, 32];

/// Writes the ESI file of the gateway, with a module for each of `slaves` in front of the common ones.
pub fn write_esi(slaves: &[SlaveSettings], into: &mut impl Write) -> Result<(), EsiError> {
    esi::write_file(
        &[(&DEVICE, None), (&LONG_DEVICE, None), (&MODULAR, Some(SLOTS)), (&LONG_MODULAR, Some(SLOTS))],
        || modules(slaves),
        into,
    )
}

/// Slaves of the settings that can be modules, then common ones.
fn modules(slaves: &[SlaveSettings]) -> impl Iterator<Item = ModbusModule> {
    let set = || slaves.iter().copied().filter(|slave| ident(slave) != 0 && modular::fits(slave));
    let numbered = slaves.iter().copied().zip(0_u8..);
    let numbered = numbered.filter(|(slave, _)| ident(slave) != 0 && modular::fits(slave));
    let all = numbered.map(|(slave, nth)| (slave, Some(nth)));
    let all = all.chain(catalogue().map(|slave| (slave, None)));
    all.enumerate().map(move |(place, (slave, nth))| {
        let before = set().chain(catalogue()).take(place);
        let variant = before.filter(|other| ident(other) == ident(&slave)).count() as u32;
        ModbusModule { slave, nth, ident: ident(&slave) | variant & VARIANTS }
    })
}

fn catalogue() -> impl Iterator<Item = SlaveSettings> {
    let of = |kind: Kind, count: u16, value_type: ValueType| {
        let mut slave = SlaveSettings::new(1);
        let cells = slave.cells.iter_mut().zip(Kind::ALL);
        cells.filter(|(_, of)| *of == kind).for_each(|(cells, _)| *cells = Cells { count, address: 0 });
        SlaveSettings { types: [value_type; 2], ..slave }
    };
    let bits = [Kind::Discrete, Kind::Coil].into_iter();
    let bits = bits.flat_map(move |kind| BITS.into_iter().map(move |count| of(kind, count, ValueType::U16)));
    let registers = [Kind::Input, Kind::Holding].into_iter().flat_map(move |kind| {
        TYPES.into_iter().flat_map(move |value_type| {
            VALUES.into_iter().map(move |values| of(kind, values * value_type.registers(), value_type))
        })
    });
    bits.chain(registers)
}

/// A module in the file.
#[derive(Clone, Copy)]
struct ModbusModule {
    slave: SlaveSettings,
    /// Which of the settings' slaves it is.
    nth: Option<u8>,
    ident: u32,
}

impl Module for ModbusModule {
    fn ident(&self) -> u32 {
        self.ident
    }

    fn class(&self) -> &'static str {
        CLASS
    }

    fn name(&self) -> impl Display {
        *self
    }

    fn object(&self, index: u16) -> Option<Object> {
        modular::object(&self.slave, 0, modular::slot_of(index)?.1)
    }

    fn start_up(&self) -> impl Iterator<Item = Command> {
        let slave = self.slave;
        (1..=SETTINGS_ENTRIES).filter_map(move |sub| {
            let value = setting(&slave, usize::from(sub) - 1)?;
            Some(Command { at: Address { index: 0x8000, sub }, value: value.into() })
        })
    }
}

impl Display for ModbusModule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut between = "";
        if let Some(nth) = self.nth {
            write!(f, "Slave {nth}, unit {}: ", self.slave.unit)?;
        }
        for table in tables(&self.slave, Channel::Inputs) {
            let (values, of) = (table.values, table.kind);
            match table.value_type {
                ValueType::Bit if of == Kind::Coil => write!(f, "{between}{values} coils")?,
                ValueType::Bit => write!(f, "{between}{values} discrete inputs")?,
                value_type => write!(f, "{between}{values} {} in {of} registers", iec(value_type))?,
            }
            between = ", ";
        }
        Ok(())
    }
}

/// What a type is called in a controller (IEC 61131-3).
fn iec(value_type: ValueType) -> &'static str {
    match value_type {
        ValueType::Bit => "BOOL",
        ValueType::U16 => "UINT",
        ValueType::I16 => "INT",
        ValueType::U32 => "UDINT",
        ValueType::I32 => "DINT",
        ValueType::F32 => "REAL",
    }
}
