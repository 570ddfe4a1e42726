//! Values of points as metrics of Sparkplug.

use core::fmt::{self, Display};

use super::mark::{Quality, Sample};
use crate::console::Values;
use crate::mqtt::Writer;
use crate::mqtt::sparkplug::{self, DataType, Metric, Value};
use crate::scanner::{LongType, LongValue, TypedValue, ValueType};
use crate::settings::PointSettings;

/// The type of a point's values: one with a scale is a float.
pub(super) fn data_type(point: &PointSettings) -> DataType {
    match point.value {
        ValueType::Bit => DataType::Boolean,
        ValueType::F32 => DataType::Float,
        ValueType::Long(long) => long_type(long, !point.scale.is_none()),
        _ if !point.scale.is_none() => DataType::Double,
        ValueType::U16 => DataType::UInt16,
        ValueType::I16 => DataType::Int16,
        ValueType::U32 => DataType::UInt32,
        ValueType::I32 => DataType::Int32,
    }
}

#[cfg(feature = "long-values")] // As the types.
fn long_type(long: LongType, is_scaled: bool) -> DataType {
    match long {
        LongType::Text(_) => DataType::String,
        LongType::U64 | LongType::I64 | LongType::F64 if is_scaled => DataType::Double,
        LongType::U64 => DataType::UInt64,
        LongType::I64 => DataType::Int64,
        LongType::F64 => DataType::Double,
    }
}

#[cfg(not(feature = "long-values"))]
fn long_type(long: LongType, _: bool) -> DataType {
    match long {}
}

#[cfg(feature = "long-values")] // As the values.
fn long_value<'v>(long: &'v LongValue<'_>) -> Value<&'v dyn Display> {
    match long {
        LongValue::U64(value) => Value::Long(*value),
        LongValue::I64(value) => Value::Long(value.cast_unsigned()),
        LongValue::F64(value) => Value::Double(*value),
        LongValue::Scaled(value) => Value::Double(value.binary()),
        LongValue::Text(text) => Value::String(text),
    }
}

#[cfg(not(feature = "long-values"))]
fn long_value<'v>(long: &'v LongValue<'_>) -> Value<&'v dyn Display> {
    long.never()
}

fn value<'v>(typed: &'v TypedValue<'_>, kind: DataType) -> Value<&'v dyn Display> {
    match (typed, kind) {
        (TypedValue::Whole(value), DataType::Boolean) => Value::Boolean(*value != 0),
        (TypedValue::Whole(value), DataType::Int16) => Value::Int((*value as u16).into()),
        (TypedValue::Whole(value), _) => Value::Int(*value as u32),
        (TypedValue::Fraction(value), _) => Value::Float(*value),
        (TypedValue::Long(long), _) => long_value(long),
    }
}

/// Writes the values of a point: each is a metric, with a number if the point has several. `None` is one that is being written.
pub(super) fn write(
    point: &PointSettings,
    cells: &[u8],
    sample: Option<&Sample>,
    timestamp: u64,
    is_birth: bool,
    out: &mut Writer<'_>,
) {
    let quality = match sample.map(|sample| sample.quality) {
        Some(Quality::Good | Quality::Written) => sparkplug::Quality::Good,
        Some(Quality::Unknown) => sparkplug::Quality::Bad,
        Some(Quality::Stale) | None => sparkplug::Quality::Stale,
    };
    let PointSettings { value: of, scale, count, .. } = *point;
    let (kind, values) = (data_type(point), Values { value: of, scale, cells, range: 0..count.into() });
    for nth in values.range.clone() {
        let typed = sample.filter(|sample| sample.is_known).and_then(|_| values.get(nth));
        let name = fmt::from_fn(|f| match count {
            1 => write!(f, "{}", point.name),
            _ => write!(f, "{}/{nth}", point.name),
        });
        out.metric(&Metric {
            name: &name,
            timestamp: Some(timestamp),
            kind: is_birth.then_some(kind),
            quality: Some(quality),
            value: typed.as_ref().map(|typed| value(typed, kind)),
        });
    }
}
