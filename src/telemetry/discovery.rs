//! How Home Assistant finds points: a retained configuration for each value (MQTT discovery).
//!
//! A value is available while the gateway is online and has read it: a stale one is not shown as the present one.

use core::fmt::{self, Write};

use crate::language::json::Quoted;
use crate::scanner::{ValueType, Writing};
use crate::settings::{PointAt, PointSettings, Publisher, Settings};

/// Values of a point that are announced one by one; a point with more is not announced.
const VALUES_MAX: u16 = 16;

/// What a value is to Home Assistant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Component {
    BinarySensor,
    Sensor,
    Switch,
    Number,
    Text,
}

impl Component {
    fn of(point: &PointSettings, writes: bool) -> Self {
        match (point.value, writes && point.count == 1) {
            (ValueType::Bit, false) => Self::BinarySensor,
            (_, false) => Self::Sensor,
            (ValueType::Bit, true) => Self::Switch,
            (value, true) if value.is_text() => Self::Text,
            (_, true) => Self::Number,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::BinarySensor => "binary_sensor",
            Self::Sensor => "sensor",
            Self::Switch => "switch",
            Self::Number => "number",
            Self::Text => "text",
        }
    }
}

/// The point that `point` shows: itself, or another.
fn shown<'a>(settings: &'a Settings, point: &'a PointSettings) -> Option<&'a PointSettings> {
    match point.at {
        PointAt::Local { of: Some(of), .. } => settings.points.get(usize::from(of)),
        _ => Some(point),
    }
}

/// Whether messages may write it.
fn is_writable(shown: &PointSettings) -> bool {
    match shown.at {
        PointAt::Device { write, .. } => write != Writing::Never,
        PointAt::Local { .. } => true,
    }
}

/// Writes the limits of a number. Home Assistant wants some for floats too, and no step below a thousandth.
fn write_limits(shown: &PointSettings, out: &mut dyn Write) -> fmt::Result {
    match shown.scale.limits(shown.value, shown.value_bits()) {
        Some([least, most, step]) => write!(out, "\"min\":{least},\"max\":{most},\"step\":{step},"),
        None => out.write_str("\"min\":-1000000000,\"max\":1000000000,\"step\":0.001,"),
    }
}

/// A text of topics and ids of Home Assistant, in which `/` and `.` are `_`.
struct Id<'i>(&'i str);

impl fmt::Display for Id<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.chars().try_for_each(|char| f.write_char(if matches!(char, '/' | '.') { '_' } else { char }))
    }
}

/// One value of a point.
pub(super) struct Announced<'a> {
    publisher: &'a Publisher,
    point: &'a PointSettings,
    /// The point that it shows.
    shown: &'a PointSettings,
    nth: u16,
    component: Component,
}

impl<'a> Announced<'a> {
    /// Value `nth` of point `at`; `None` if it is not announced.
    pub(super) fn new(
        publisher: &'a Publisher,
        settings: &'a Settings,
        (at, nth): (usize, u16),
    ) -> Option<Self> {
        let point = settings.points.get(at)?;
        let shown = shown(settings, point)?;
        let component = Component::of(point, publisher.commands && is_writable(shown));
        let is_announced = nth < point.count && point.count <= VALUES_MAX;
        is_announced.then_some(Self { publisher, point, shown, nth, component })
    }

    /// What tells it from other values.
    fn write_id(&self, out: &mut dyn Write) -> fmt::Result {
        write!(out, "{}", Id(&self.point.name))?;
        if self.point.count > 1 { write!(out, "_{}", self.nth) } else { Ok(()) }
    }

    /// What it is called.
    fn write_name(&self, out: &mut dyn Write) -> fmt::Result {
        let PointSettings { name, label, count, .. } = self.point;
        write!(out, "{}", if label.is_empty() { name.as_str() } else { label.as_str() })?;
        if *count > 1 { write!(out, " {}", self.nth) } else { Ok(()) }
    }

    /// The configuration.
    pub(super) fn write(&self, out: &mut dyn Write) -> fmt::Result {
        let Self { publisher, point, .. } = self;
        let (prefix, own) = (&publisher.topic, &publisher.name);
        let id = Id(prefix);
        write!(out, "{{\"name\":{},", Quoted(fmt::from_fn(|f| self.write_name(f))))?;
        write!(out, "\"unique_id\":\"{id}_{}\",", fmt::from_fn(|f| self.write_id(f)))?;
        write!(out, "\"state_topic\":\"{prefix}/points/{}\",\"value_template\":\"", point.name)?;
        match point.count {
            1 => out.write_str("{{ value_json.value }}\",")?,
            _ => write!(out, "{{{{ value_json.value[{}] }}}}\",", self.nth)?,
        }
        write!(
            out,
            "\"availability_mode\":\"all\",\"availability\":[{{\"topic\":\"{prefix}/{own}/status\"}},\
             {{\"topic\":\"{prefix}/points/{}\",\"value_template\":\"{{{{ 'online' if value_json.quality \
             in ['good', 'written'] else 'offline' }}}}\"}}],",
            point.name
        )?;
        self.write_component(out)?;
        write!(
            out,
            "\"device\":{{\"identifiers\":[\"{id}\"],\"name\":\"{prefix}\",\"manufacturer\":\"mobgate\",\
             \"model\":\"Modbus gateway\",\"sw_version\":\"{}\"}}}}",
            env!("CARGO_PKG_VERSION")
        )
    }

    /// What only this component has.
    fn write_component(&self, out: &mut dyn Write) -> fmt::Result {
        let Self { publisher, point, shown, component, .. } = self;
        let set = fmt::from_fn(|f| {
            write!(f, "\"command_topic\":\"{}/points/{}/set\",", publisher.topic, point.name)
        });
        match component {
            Component::Sensor => Ok(()),
            Component::BinarySensor => out.write_str("\"payload_on\":\"1\",\"payload_off\":\"0\","),
            Component::Switch => write!(
                out,
                "{set}\"payload_on\":\"1\",\"payload_off\":\"0\",\"state_on\":\"1\",\"state_off\":\"0\","
            ),
            Component::Number => {
                write!(out, "{set}\"mode\":\"box\",")?;
                write_limits(shown, out)
            }
            Component::Text => write!(out, "{set}\"max\":{},", 2 * point.value.registers()),
        }
    }

    /// Its topic.
    pub(super) fn topic(&self) -> impl fmt::Display {
        fmt::from_fn(|f| {
            let (component, prefix) = (self.component.name(), Id(&self.publisher.topic));
            write!(f, "homeassistant/{component}/{prefix}/")?;
            self.write_id(f)?;
            f.write_str("/config")
        })
    }
}

/// The value behind this one, of the same point or the next; `None` behind the last.
pub(super) fn behind(settings: &Settings, (at, nth): (usize, u16)) -> Option<(usize, u16)> {
    let point = settings.points.get(at)?;
    let is_last = nth + 1 >= point.count || point.count > VALUES_MAX;
    Some(if is_last { (at + 1, 0) } else { (at, nth + 1) })
}
