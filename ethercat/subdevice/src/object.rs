//! The object dictionary as data: one table for SDO, SDO information, SII image and ESI file.
//!
//! A device's table is a `const`, sorted by index. It contains constant numbers and texts; values kept by the stack itself (PDO
//! assignment, synchronisation) are marked as such, and the application provides all others.

mod runs;
mod types;

use core::fmt;

use crate::sync_manager::Channel;

pub use runs::{Mapped, PADDING, RUNS_MAX, Runs};
pub use types::{Access, DataType};

/// Most PDOs of a SyncManager: one per module for 32 modules, and one for the device.
pub const PDOS_ASSIGNED_MAX: usize = 33;
/// Most PDOs that a MainDevice can assign to a SyncManager.
pub const PDOS_SELECTED_MAX: usize = 8;

/// An object: an index with one or more entries.
#[derive(Debug, Clone, Copy)]
pub struct Object {
    /// Its index.
    pub index: u16,
    /// Its name.
    pub name: &'static str,
    /// Its sub-indices.
    pub entries: Entries,
}

/// The entries of an object.
#[derive(Debug, Clone, Copy)]
pub enum Entries {
    /// One value, at sub-index 0.
    Variable(Entry),
    /// `count` values of one kind from sub-index 1 on; sub-index 0 is the count.
    Array(u8, Entry),
    /// The same with constant numbers.
    Constants(&'static [u32], Entry),
    /// Values of different kinds; an [absent](Entry::ABSENT) one skips its sub-index.
    Record(&'static [Entry]),
    /// The PDOs of a SyncManager: the list after power-on, which a MainDevice may change if writable. If it is fixed and empty, the
    /// application makes the assignment.
    Assignment(&'static [u16], Access),
    /// The content of a PDO, and its rules of assignment.
    Mapping(Runs, PdoRules),
}

/// Rules for the assignment of a PDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PdoRules {
    /// PDOs that cannot be assigned together with it.
    pub excluded: &'static [u16],
    /// Whether the EEPROM and the ESI file describe it, or only the dictionary.
    pub described: bool,
}

impl PdoRules {
    /// Compatible with all others, and described.
    pub const NONE: Self = Self { excluded: &[], described: true };
}

/// One value of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Its name.
    pub name: &'static str,
    /// Number after the name, for one of several equal entries.
    pub number: Option<u8>,
    /// Its type.
    pub data_type: DataType,
    /// Access rights per state.
    pub access: Access,
    /// Source of its value.
    pub value: Value,
    /// The least and the greatest writable number; `u32::MAX` means no limit. Small, since a device has hundreds of entries.
    pub range: (u32, u32),
}

/// The name of an entry, with its number if it has one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Label {
    name: &'static str,
    number: Option<u8>,
}

impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)?;
        self.number.map_or(Ok(()), |number| write!(f, " {number}"))
    }
}

/// Source of an entry's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Value {
    /// From the table: a number.
    Number(u32),
    /// From the table: a text.
    Text(&'static str),
    /// From the stack; the number is its value after power-on.
    Stack(u32),
    /// From the stack, depending on hardware and settings: there is no fixed value after power-on.
    Computed,
    /// From the application; the number is its value after power-on.
    Application(u32),
}

impl Entry {
    /// In a record: there is no entry at this sub-index.
    pub const ABSENT: Self = Self { access: Access(0), ..Self::number("", DataType::U8, 0) };

    /// A constant number.
    pub const fn number(name: &'static str, data_type: DataType, value: u32) -> Self {
        let value = Value::Number(value);
        Self { name, number: None, data_type, access: Access::READ, value, range: (0, u32::MAX) }
    }

    /// A constant text.
    pub const fn text(name: &'static str, text: &'static str) -> Self {
        let data_type = DataType::Text(text.len() as u16);
        Self { value: Value::Text(text), ..Self::number(name, data_type, 0) }
    }

    /// A read-only value of the application.
    pub const fn reading(name: &'static str, data_type: DataType) -> Self {
        Self { value: Value::Application(0), ..Self::number(name, data_type, 0) }
    }

    /// The same, mappable to a TxPDO.
    pub const fn input(name: &'static str, data_type: DataType) -> Self {
        Self::reading(name, data_type).with_access(Access::READ.and(Access::TX_PDO))
    }

    /// The same, mappable to an RxPDO.
    pub const fn output(name: &'static str, data_type: DataType) -> Self {
        Self::reading(name, data_type).with_access(Access::READ.and(Access::RX_PDO))
    }

    /// A setting of the application, writable in every state; a number must be within `range`.
    pub const fn setting(name: &'static str, data_type: DataType, default: u32, range: (u32, u32)) -> Self {
        let access = Access::READ.and(Access::WRITE).and(Access::SETTING);
        Self { value: Value::Application(default), access, range, ..Self::number(name, data_type, 0) }
    }

    /// A value kept by the stack.
    pub const fn of_stack(name: &'static str, data_type: DataType, default: u32, access: Access) -> Self {
        Self { value: Value::Stack(default), access, ..Self::number(name, data_type, 0) }
    }

    /// The same with other rights.
    #[must_use]
    pub const fn with_access(self, access: Access) -> Self {
        Self { access, ..self }
    }

    /// The same in an array with numbered entries: the sub-index is appended to their name.
    #[must_use]
    pub const fn numbered(self) -> Self {
        Self { number: Some(0), ..self }
    }

    /// The displayed name: `Coil 3`.
    pub const fn label(&self) -> Label {
        Label { name: self.name, number: self.number }
    }

    /// A value of the application that is not 0 after power-on.
    #[must_use]
    pub const fn with_default(self, value: u32) -> Self {
        Self { value: Value::Application(value), ..self }
    }

    /// The value after power-on, if it is a number.
    pub const fn default_number(&self) -> Option<u64> {
        match self.value {
            Value::Number(value) | Value::Stack(value) | Value::Application(value)
                if self.data_type.is_number() =>
            {
                Some(value as u64)
            }
            _ => None,
        }
    }

    /// The greatest writable number.
    pub const fn greatest(&self) -> u64 {
        match self.range.1 as u64 {
            greatest if greatest < u32::MAX as u64 && greatest < self.data_type.greatest() => greatest,
            _ => self.data_type.greatest(),
        }
    }
}

impl Object {
    /// An object with one value.
    pub const fn variable(index: u16, entry: Entry) -> Self {
        Self { index, name: entry.name, entries: Entries::Variable(entry) }
    }

    /// An object with `count` values of one kind.
    pub const fn array(index: u16, name: &'static str, count: u8, entry: Entry) -> Self {
        Self { index, name, entries: Entries::Array(count, entry) }
    }

    /// An object with values of different kinds.
    pub const fn record(index: u16, name: &'static str, entries: &'static [Entry]) -> Self {
        Self { index, name, entries: Entries::Record(entries) }
    }

    /// A PDO.
    pub const fn mapping(index: u16, name: &'static str, mapped: &[Mapped]) -> Self {
        Self { index, name, entries: Entries::Mapping(Runs::of(mapped), PdoRules::NONE) }
    }

    /// The same PDO, not assignable together with the PDOs `excluded`.
    #[must_use]
    pub const fn excluding(self, excluded: &'static [u16]) -> Self {
        match self.entries {
            Entries::Mapping(mapped, rules) => {
                Self { entries: Entries::Mapping(mapped, PdoRules { excluded, ..rules }), ..self }
            }
            _ => self,
        }
    }

    /// The same PDO, only in the dictionary: each entry takes eight bytes of the EEPROM, which may have no room for another view of
    /// the same values.
    #[must_use]
    pub const fn undescribed(self) -> Self {
        match self.entries {
            Entries::Mapping(mapped, rules) => {
                Self { entries: Entries::Mapping(mapped, PdoRules { described: false, ..rules }), ..self }
            }
            _ => self,
        }
    }

    /// The greatest sub-index.
    pub fn sub_max(&self) -> u8 {
        match self.entries {
            Entries::Variable(_) => 0,
            Entries::Array(count, _) => count,
            Entries::Constants(values, _) => values.len() as u8,
            Entries::Record(entries) => entries.len() as u8,
            Entries::Assignment(_, access) if access.any(Access::WRITE) => PDOS_SELECTED_MAX as u8,
            // The application's assignment, whose length varies.
            Entries::Assignment([], _) => PDOS_ASSIGNED_MAX as u8,
            Entries::Assignment(fixed, _) => fixed.len() as u8,
            Entries::Mapping(mapped, _) => mapped.iter().fold(0, |sum, run| sum.saturating_add(run.count)),
        }
    }

    /// The entry at sub-index `sub`.
    pub fn entry(&self, sub: u8) -> Option<Entry> {
        if let Entries::Variable(entry) = self.entries {
            return (sub == 0).then_some(entry);
        }
        if sub == 0 {
            return Some(self.count_entry());
        }
        match self.entries {
            Entries::Array(count, entry) => {
                (sub <= count).then_some(Entry { number: entry.number.map(|_| sub), ..entry })
            }
            Entries::Constants(values, entry) => {
                let &value = values.get(usize::from(sub) - 1)?;
                Some(Entry { value: Value::Number(value), ..entry })
            }
            Entries::Record(entries) => {
                entries.get(usize::from(sub) - 1).copied().filter(|entry| *entry != Entry::ABSENT)
            }
            Entries::Assignment(initial, access) => (sub <= self.sub_max()).then(|| {
                let default = initial.get(usize::from(sub) - 1).copied().unwrap_or_default();
                Entry::of_stack("PDO", DataType::U16, default.into(), access)
            }),
            Entries::Mapping(..) => {
                let value = self.mapped().nth(usize::from(sub) - 1)?;
                Some(Entry::number("Mapped entry", DataType::U32, value))
            }
            Entries::Variable(_) => None,
        }
    }

    fn count_entry(&self) -> Entry {
        const NAME: &str = "Number of entries";
        match self.entries {
            Entries::Assignment(initial, access) => {
                Entry::of_stack(NAME, DataType::U8, initial.len() as u32, access)
            }
            _ => Entry::number(NAME, DataType::U8, self.sub_max().into()),
        }
    }

    /// The object code: VAR, ARRAY or RECORD.
    pub const fn code(&self) -> u8 {
        match self.entries {
            Entries::Variable(_) => 7,
            Entries::Array(..) | Entries::Constants(..) | Entries::Assignment(..) => 8,
            Entries::Record(_) | Entries::Mapping(..) => 9,
        }
    }

    /// The data type: for VAR and ARRAY that of the values, for RECORD its own (ETG.1000.6, table 63).
    pub const fn data_type(&self) -> u16 {
        match self.entries {
            Entries::Variable(entry) | Entries::Array(_, entry) | Entries::Constants(_, entry) => {
                entry.data_type.code()
            }
            Entries::Assignment(..) => DataType::U16.code(),
            Entries::Mapping(..) => 0x0021,
            Entries::Record(_) => match self.index {
                0x1018 => 0x0023,
                0x1c32 | 0x1c33 => 0x0029,
                // The first manufacturer-specific number.
                _ => 0x0040,
            },
        }
    }

    /// The SyncManager of a PDO.
    pub const fn pdo(&self) -> Option<Channel> {
        match (&self.entries, self.index) {
            (Entries::Mapping(..), 0x1600..=0x17ff) => Some(Channel::Outputs),
            (Entries::Mapping(..), 0x1a00..=0x1bff) => Some(Channel::Inputs),
            _ => None,
        }
    }

    /// The mapped entries of a PDO, encoded as its values: index, sub-index, bits.
    pub fn mapped(&self) -> impl Iterator<Item = u32> + use<> {
        let runs = match self.entries {
            Entries::Mapping(runs, _) => runs,
            _ => Runs::NONE,
        };
        runs.all().flat_map(|run| {
            let subs = u32::from(run.sub)..u32::from(run.sub) + u32::from(run.count);
            subs.map(move |sub| u32::from(run.index) << 16 | sub << 8 | u32::from(run.bits))
        })
    }

    /// Whether this PDO and `other` cannot be assigned together.
    pub fn excludes(&self, other: &Self) -> bool {
        let names = |one: &Self, index: u16| match one.entries {
            Entries::Mapping(_, rules) => rules.excluded.contains(&index),
            _ => false,
        };
        names(self, other.index) || names(other, self.index)
    }

    /// Bytes of a PDO.
    pub fn pdo_bytes(&self) -> usize {
        let Entries::Mapping(runs, _) = self.entries else { return 0 };
        let bits: usize = runs.iter().map(|run| usize::from(run.count) * usize::from(run.bits)).sum();
        bits.div_ceil(8)
    }
}
