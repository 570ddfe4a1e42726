//! Data points in the settings: devices that the gateway asks by itself, and points that tie their cells to variables.

use core::fmt::{self, Display};

use embassy_time::{Duration, Instant};
use heapless::String;

use super::print::option;
use super::values::Time;
use super::{NAME_BYTES_MAX, Settings};
use crate::scanner::{
    ByteOrder, Device, DeviceId, Form, Full, Kind, POINTS, ROWS_MAX, Reading, RegisterBit, Row, RowId,
    Scanner, ValueType, Writing,
};

/// Points that settings can hold.
pub const POINTS_MAX: usize = if POINTS { POINTS_MOST } else { 0 };
const POINTS_MOST: usize = if cfg!(feature = "small") { 64 } else { 128 };
/// Longest label of a device or a point in bytes.
pub const LABEL_BYTES_MAX: usize = 23;

const _: () = assert!(POINTS_MOST <= ROWS_MAX);

/// The name of a device or a point. Settings have many of them, and there is a draft besides: they must be small.
pub type PointName = String<NAME_BYTES_MAX, u8>;
/// What people call it; may be empty.
pub type Label = String<LABEL_BYTES_MAX, u8>;

/// A device that the scanner asks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceSettings {
    /// Unique among devices, without regard to case.
    pub name: PointName,
    /// What it is for the scanner.
    pub device: Device,
    /// What people call it.
    pub label: Label,
}

/// A point: a variable, and the cells that it is tied to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PointSettings {
    /// Unique among points, without regard to case.
    pub name: PointName,
    /// Where it is.
    pub at: PointAt,
    /// The table.
    pub kind: Kind,
    /// The first cell's address, as it is on the wire.
    pub first: u16,
    /// How many values.
    pub count: u16,
    /// What the values are; bits in a table of bits, if it does not say another type.
    pub value: ValueType,
    /// What people call it.
    pub label: Label,
}

/// Where the cells of a point are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PointAt {
    /// In a device, which is asked.
    Device {
        /// Its place among the devices.
        device: u8,
        /// When they are read.
        read: Reading,
        /// When they are written.
        write: Writing,
        /// One cell is written by function 15 or 16 as well.
        multiple: bool,
        /// The bit of a register that it is.
        bit: Option<RegisterBit>,
    },
    /// In the gateway's own unit, where outside clients find them.
    Local {
        /// The point whose variable this is; none: its own.
        of: Option<u8>,
        /// Input registers with its status word and age.
        quality: Option<u16>,
    },
}

impl PointSettings {
    /// How many cells it has.
    pub fn cells(&self) -> u16 {
        let each = if self.kind.is_bits() { self.value.bits() } else { self.value.registers() };
        self.count.saturating_mul(each)
    }

    /// Bytes of memory that its own variable takes.
    pub(super) fn bytes(&self) -> usize {
        match self.at {
            PointAt::Local { of: Some(_), .. } => 0,
            _ if self.value == ValueType::Bit => Kind::Coil.bytes(self.count).into(),
            _ => Kind::Holding.bytes(self.count.saturating_mul(self.value.registers())).into(),
        }
    }

    /// What its cells are in its variable.
    fn form(&self) -> Form {
        match (self.at, self.kind.is_bits(), self.value.bits()) {
            (PointAt::Device { bit: Some(bit), .. }, ..) => Form::Bit(bit),
            (_, true, 16) => Form::Words,
            (_, true, 32) => Form::Longs,
            (_, false, 32) => Form::Wide,
            _ => Form::Cells,
        }
    }

    /// The row that it is in a scanner, with its values from the place `values` on.
    fn row(&self, values: u16) -> Row {
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
                Row { device: Some(DeviceId(device)), read, write, multiple, ..row }
            }
            PointAt::Local { of, quality } => Row { of: of.map(RowId), quality, ..row },
        }
    }
}

/// What the values of a point are that does not say it.
pub(super) const fn usual_type(kind: Kind) -> ValueType {
    if kind.is_bits() { ValueType::Bit } else { ValueType::U16 }
}

/// When a point is read that says no more than when it is written. The source's rows are neither read nor written if they do not
/// say so; one that is written only is not read here either.
pub(super) fn usual_reading(write: Writing) -> Reading {
    match write {
        Writing::Auto | Writing::OnChange => Reading::Manual,
        Writing::Manual | Writing::Never => Reading::Normal,
    }
}

impl Settings {
    /// The place of the point called `name`.
    pub fn find_point(&self, name: &str) -> Option<u8> {
        let place = self.points.iter().position(|point| point.name.eq_ignore_ascii_case(name))?;
        u8::try_from(place).ok()
    }

    /// The place of the device called `name`.
    pub fn find_device(&self, name: &str) -> Option<u8> {
        let place = self.devices.iter().position(|device| device.name.eq_ignore_ascii_case(name))?;
        u8::try_from(place).ok()
    }

    /// The name of the device at `place`; `?` when there is none.
    pub fn device_name(&self, place: u8) -> &str {
        self.devices.get(usize::from(place)).map_or("?", |device| &device.name)
    }
}

/// What new settings have done to the points that were there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reloaded {
    /// They are the same.
    Nothing,
    /// Others came behind them.
    Added,
    /// All begin anew.
    All,
}

/// Makes `scanner` ask for the points of `new`, where `old` has been in force: a device is a device there, and a point is
/// the row at the same place. Points that are added behind the others leave those as they are; after any other change all
/// begin anew.
pub(crate) fn load(
    scanner: &mut Scanner,
    old: &Settings,
    new: &Settings,
    now: Instant,
) -> Result<Reloaded, Full> {
    let added = new.devices.starts_with(&old.devices) && new.points.starts_with(&old.points);
    if added && (new.devices.len(), new.points.len()) == (scanner.devices(), scanner.rows()) {
        return Ok(Reloaded::Nothing);
    }
    let reloaded =
        if added && scanner.devices() + scanner.rows() > 0 { Reloaded::Added } else { Reloaded::All };
    if reloaded == Reloaded::All {
        scanner.restart(now);
    }
    for device in new.devices.iter().skip(scanner.devices()) {
        scanner.add_device(device.device)?;
    }
    for point in new.points.iter().skip(scanner.rows()) {
        let values = scanner.allocate(point.bytes() as u16)?;
        scanner.add_row(point.row(values), now)?;
    }
    Ok(reloaded)
}

/// A line that makes the device.
impl Display for DeviceSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, device, label } = self;
        write!(f, "device {name} unit {}", device.unit)?;
        option(f, "order", device.order, device.order != ByteOrder::default())?;
        if device.check {
            f.write_str(" check")?;
        }
        option(f, "label", Quoted(label), !label.is_empty())
    }
}

/// Words behind a point's name, which need to know other names.
pub(super) struct PointWords<'s> {
    pub(super) settings: &'s Settings,
    pub(super) point: &'s PointSettings,
}

impl Display for PointWords<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let PointSettings { at, kind, first, count, value, label, .. } = self.point;
        let of = match at {
            PointAt::Device { device, .. } => {
                f.write_str(self.settings.device_name(*device))?;
                None
            }
            PointAt::Local { of, .. } => {
                f.write_str("local")?;
                of.map(|of| self.settings.points.get(usize::from(of)).map_or("?", |point| &point.name))
            }
        };
        write!(f, " {kind} {first}")?;
        if let Some(of) = of {
            option(f, "of", of, true)?;
        } else {
            let count = if kind.is_bits() { self.point.cells() } else { *count };
            option(f, "count", count, count != 1)?;
            option(f, "as", value.name(), ![usual_type(*kind), ValueType::Bit].contains(value))?;
        }
        match *at {
            PointAt::Device { read, write, multiple, bit, .. } => {
                option(f, "bit", bit.map_or(0, |bit| bit as u8), bit.is_some())?;
                option(f, "read", read, read != usual_reading(write))?;
                option(f, "write", "auto", write == Writing::Auto)?;
                option(f, "write", "change", write == Writing::OnChange)?;
                if multiple {
                    f.write_str(" multiple")?;
                }
            }
            PointAt::Local { quality, .. } => {
                if let Some(quality) = quality {
                    option(f, "quality", quality, true)?;
                }
            }
        }
        option(f, "label", Quoted(label), !label.is_empty())
    }
}

struct Quoted<'l>(&'l Label);

impl Display for Quoted<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{}\"", self.0)
    }
}

impl Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Coil => "coil",
            Self::Discrete => "discrete",
            Self::Input => "input",
            Self::Holding => "holding",
        })
    }
}

impl Display for ByteOrder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Order0123 => "0123",
            Self::Order2301 => "2301",
            Self::Order1032 => "1032",
            Self::Order3210 => "3210",
        })
    }
}

impl Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Low => f.pad("low"),
            Self::Normal => f.pad("normal"),
            Self::High => f.pad("high"),
            Self::Manual => f.pad("manual"),
            Self::Every(ms) => Time(Duration::from_millis((*ms).into())).fmt(f),
        }
    }
}

const _: () = assert!(POINTS_MAX <= u8::MAX as usize, "a place is a byte");
const _: () = assert!(size_of::<PointSettings>() <= 60, "there are many points, twice");
