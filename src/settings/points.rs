//! Data points in the settings: devices that the gateway polls, and points that map their cells to variables.

use heapless::String;

use crate::scanner::{
    Device, DeviceId, Form, Kind, LONG_VALUES, POINTS, ROWS_MAX, Reading, RegisterBits, Row, RowId, Scale,
    ValueType, Writing,
};
use crate::settings::NAME_BYTES_MAX;

/// Points in the settings.
pub(crate) const POINTS_MAX: usize = if POINTS { POINTS_MOST } else { 0 };

const POINTS_MOST: usize = if cfg!(feature = "small") { 64 } else { 128 };

/// Longest label of a device or a point in bytes.
pub(crate) const LABEL_BYTES_MAX: usize = 23;

const _: () = assert!(POINTS_MOST <= ROWS_MAX);

/// The name of a device or a point. Settings and the draft contain many, so it must be small.
pub type PointName = String<NAME_BYTES_MAX, u8>;

/// A label for people; may be empty.
pub type Label = String<LABEL_BYTES_MAX, u8>;

/// A device polled by the scanner.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceSettings {
    /// Unique among devices, without regard to case.
    pub name: PointName,
    /// Its scanner parameters.
    pub device: Device,
    /// A label for people.
    pub label: Label,
}

/// A point: a variable, and the cells it is mapped to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PointSettings {
    /// Unique among points, without regard to case.
    pub name: PointName,
    /// Location of its cells.
    pub at: PointAt,
    /// The table.
    pub kind: Kind,
    /// The first address, as on the wire.
    pub first: u16,
    /// Number of values.
    pub count: u16,
    /// The type of the values; bits in a table of bits unless set.
    pub value: ValueType,
    /// How people see its raw numbers; that of the point which it shows.
    pub scale: Scale,
    /// A label for people.
    pub label: Label,
}

/// The location of a point's cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PointAt {
    /// In a polled device.
    Device {
        /// Index of the device.
        device: u8,
        /// When they are read.
        read: Reading,
        /// When they are written.
        write: Writing,
        /// Uses function 15 or 16 even for one cell.
        multiple: bool,
        /// The bits of a register, for a point that is no more than that.
        bits: Option<RegisterBits>,
    },
    /// In the gateway's own unit, for outside clients.
    Local {
        /// The point whose variable it shows; `None`: its own.
        of: Option<u8>,
        /// Input registers with its status word and age.
        quality: Option<u16>,
    },
}

impl PointSettings {
    /// Number of cells.
    pub fn cells(&self) -> u16 {
        let each = if self.kind.is_bits() { self.value.bits() } else { self.value.registers() };
        self.count.saturating_mul(each)
    }

    /// Bits of the number that is one of its values.
    // Only images with points have the console's commands for them.
    #[cfg_attr(not(feature = "points"), allow(dead_code))]
    pub(crate) fn value_bits(&self) -> u16 {
        match self.at {
            PointAt::Device { bits: Some(bits), .. } => bits.count(),
            _ => self.value.bits(),
        }
    }

    /// Bytes of memory for its own variable: twice for one that is written periodically, as its last written value is kept.
    pub(crate) fn bytes(&self) -> usize {
        match self.at {
            PointAt::Local { of: Some(_), .. } => 0,
            PointAt::Device { write: Writing::Every(_), .. } => 2 * usize::from(self.variable_bytes()),
            _ => self.variable_bytes().into(),
        }
    }

    fn variable_bytes(&self) -> u16 {
        match self.value {
            ValueType::Bit => Kind::Coil.bytes(self.count),
            value => Kind::Holding.bytes(self.count.saturating_mul(value.registers())),
        }
    }

    /// The mapping of its cells to its variable.
    #[cfg_attr(not(feature = "long-values"), allow(unreachable_code))] // There is no longer type.
    fn form(&self) -> Form {
        match (self.at, self.kind.is_bits(), self.value) {
            (PointAt::Device { bits: Some(bits), .. }, ..) => Form::Bits(bits),
            (_, true, ValueType::Bit) => Form::Cells,
            (_, true, ValueType::Long(long)) => Form::Long(long.form_of_bits()),
            (_, true, ValueType::U16 | ValueType::I16) => Form::Words,
            (_, true, ValueType::U32 | ValueType::I32 | ValueType::F32) => Form::Longs,
            (_, false, value) => value.form(),
        }
    }

    /// Its scanner row, with values from index `values` on.
    pub(crate) fn row(&self, values: u16) -> Row {
        let row = Row {
            device: None,
            kind: self.kind,
            first: self.first,
            count: self.cells(),
            input: values,
            output: values,
            read: Reading::Manual,
            write: Writing::Never,
            multiple: false,
            form: self.form(),
            of: None,
            quality: None,
        };
        match self.at {
            PointAt::Device { device, read, write, multiple, .. } => {
                let output = match write {
                    Writing::Every(_) => values.saturating_add(self.variable_bytes()),
                    _ => values,
                };
                Row { device: Some(DeviceId(device)), read, write, multiple, output, ..row }
            }
            PointAt::Local { of, quality } => Row { of: of.map(RowId), quality, ..row },
        }
    }
}

const _: () = assert!(POINTS_MAX <= u8::MAX as usize, "a place is a byte");

const _: () =
    assert!(size_of::<PointSettings>() <= if LONG_VALUES { 80 } else { 60 }, "there are many points, twice");
