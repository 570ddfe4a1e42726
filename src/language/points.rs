//! Prints data points: `device meter unit 2`, `point power meter holding 0 count 3`.

use core::fmt::{self, Display};

use embassy_time::Duration;

use super::option::option;
use crate::scanner::{ByteOrder, Kind, Reading, ValueType, Writing};
use crate::settings::{DeviceSettings, Label, PointAt, PointSettings, Settings, Time};

/// The default type of a point's values.
pub(crate) const fn usual_type(kind: Kind) -> ValueType {
    if kind.is_bits() { ValueType::Bit } else { ValueType::U16 }
}

/// The default reading of a point, which depends on its writing: one that is only written is not read.
pub(crate) fn usual_reading(write: Writing) -> Reading {
    match write {
        Writing::Auto | Writing::OnChange | Writing::Every(_) => Reading::Manual,
        Writing::Manual | Writing::Never => Reading::Normal,
    }
}

/// The line that creates the device.
impl Display for DeviceSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, device, label } = self;
        write!(f, "device {name} unit {}", device.unit)?;
        option(f, "order", &device.order, device.order != ByteOrder::default())?;
        if device.check {
            f.write_str(" check")?;
        }
        option(f, "label", &Quoted(label), !label.is_empty())
    }
}

/// The words after a point's name; some need the names of others.
pub(crate) struct PointWords<'s> {
    pub(crate) settings: &'s Settings,
    pub(crate) point: &'s PointSettings,
}

impl Display for PointWords<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let PointSettings { at, kind, first, count, value, scale, label, .. } = self.point;
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
            option(f, "of", &of, true)?;
        } else {
            let count = if kind.is_bits() { self.point.cells() } else { *count };
            option(f, "count", &count, count != 1)?;
            option(f, "as", value, ![usual_type(*kind), ValueType::Bit].contains(value))?;
            scale.write(f)?;
        }
        match *at {
            PointAt::Device { read, write, multiple, bits, .. } => {
                if let Some(bits) = bits {
                    option(f, if bits.is_one() { "bit" } else { "bits" }, &bits, true)?;
                }
                option(f, "read", &read, read != usual_reading(write))?;
                option(f, "write", &"auto", write == Writing::Auto)?;
                option(f, "write", &"change", write == Writing::OnChange)?;
                if let Some(period) = write.period() {
                    option(f, "write every", &Time(period.duration()), true)?;
                }
                if multiple {
                    f.write_str(" multiple")?;
                }
            }
            PointAt::Local { quality, .. } => {
                if let Some(quality) = quality {
                    option(f, "quality", &quality, true)?;
                }
            }
        }
        option(f, "label", &Quoted(label), !label.is_empty())
    }
}

struct Quoted<'l>(&'l Label);

impl Display for Quoted<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{}\"", self.0)
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
