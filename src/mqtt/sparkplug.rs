//! Payloads of Sparkplug B 3.0 (section 6.4), which are protobuf: written into a packet, and read from commands. Pure.
//!
//! Of the message `Payload` an edge node writes timestamp, metrics and sequence number; of a command it reads names and values.

use core::fmt::Display;

use super::receive::{Cursor, Malformed};
use super::send::{Writer, varint};

/// Bytes of the sequence number, which comes last.
pub(crate) const SEQ_BYTES_MAX: usize = 3;

/// The metric by which a host asks for a birth certificate (5.17).
pub(crate) const REBIRTH: &str = "Node Control/Rebirth";
/// The metric that tells which death belongs to which birth (6.4.25).
pub(crate) const BD_SEQ: &str = "bdSeq";

/// Types of values (6.4.16).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum DataType {
    Int16 = 2,
    Int32 = 3,
    Int64 = 4,
    UInt16 = 6,
    UInt32 = 7,
    UInt64 = 8,
    Float = 9,
    Double = 10,
    Boolean = 11,
    String = 12,
}

/// How good a value is (6.4.9.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Quality {
    Bad = 0,
    Good = 192,
    Stale = 500,
}

/// A value, as protobuf has it; `T` is text. Signed numbers are two's complement, those of 16 bits in the lower half of the 32.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Value<T> {
    Int(u32),
    Long(u64),
    Float(f32),
    Double(f64),
    Boolean(bool),
    String(T),
}

/// A metric of an edge node.
pub(crate) struct Metric<'m> {
    pub(crate) name: &'m dyn Display,
    /// Milliseconds since 1970 began, UTC.
    pub(crate) timestamp: Option<u64>,
    /// In birth and death certificates.
    pub(crate) kind: Option<DataType>,
    pub(crate) quality: Option<Quality>,
    /// `None`: it is not known.
    pub(crate) value: Option<Value<&'m dyn Display>>,
}

/// Numbers of the fields of a payload, a metric, a set of properties and a property (6.4.1).
mod payload {
    pub(super) const TIMESTAMP: u32 = 1;
    pub(super) const METRICS: u32 = 2;
    pub(super) const SEQ: u32 = 3;
}
mod metric {
    pub(super) const NAME: u32 = 1;
    pub(super) const TIMESTAMP: u32 = 3;
    pub(super) const DATATYPE: u32 = 4;
    pub(super) const IS_NULL: u32 = 7;
    pub(super) const PROPERTIES: u32 = 9;
    pub(super) const INT: u32 = 10;
    pub(super) const LONG: u32 = 11;
    pub(super) const FLOAT: u32 = 12;
    pub(super) const DOUBLE: u32 = 13;
    pub(super) const BOOLEAN: u32 = 14;
    pub(super) const STRING: u32 = 15;
}
mod properties {
    pub(super) const KEYS: u32 = 1;
    pub(super) const VALUES: u32 = 2;
    pub(super) const TYPE: u32 = 1;
    pub(super) const INT: u32 = 3;
}

/// How the value of a field is written, in the lower three bits of its tag (protobuf, "Encoding").
mod wire {
    pub(super) const VARINT: u32 = 0;
    pub(super) const EIGHT_BYTES: u32 = 1;
    pub(super) const MEASURED: u32 = 2;
    pub(super) const FOUR_BYTES: u32 = 5;
}

impl Writer<'_> {
    fn tag(&mut self, field: u32, wire: u32) {
        self.bytes(&varint((field << 3 | wire).into()));
    }

    fn field(&mut self, field: u32, number: u64) {
        self.tag(field, wire::VARINT);
        self.bytes(&varint(number));
    }

    fn field_of(&mut self, field: u32, write: impl FnOnce(&mut Self)) {
        self.tag(field, wire::MEASURED);
        self.measured(write);
    }

    fn field_text(&mut self, field: u32, text: &dyn Display) {
        self.field_of(field, |writer| writer.formatted(format_args!("{text}")));
    }

    /// When the payload is sent, in milliseconds since 1970.
    pub(crate) fn timestamp(&mut self, timestamp: u64) {
        self.field(payload::TIMESTAMP, timestamp);
    }

    pub(crate) fn seq(&mut self, seq: u8) {
        self.field(payload::SEQ, seq.into());
    }

    pub(crate) fn metric(&mut self, metric: &Metric<'_>) {
        self.field_of(payload::METRICS, |writer| writer.metric_fields(metric));
    }

    fn metric_fields(&mut self, metric: &Metric<'_>) {
        let Metric { name, timestamp, kind, quality, value } = metric;
        self.field_text(metric::NAME, *name);
        if let Some(timestamp) = timestamp {
            self.field(metric::TIMESTAMP, *timestamp);
        }
        if let Some(kind) = kind {
            self.field(metric::DATATYPE, *kind as u64);
        }
        if value.is_none() {
            self.field(metric::IS_NULL, 1);
        }
        if let Some(quality) = quality {
            self.field_of(metric::PROPERTIES, |writer| writer.quality(*quality));
        }
        match *value {
            Some(Value::Int(value)) => self.field(metric::INT, value.into()),
            Some(Value::Long(value)) => self.field(metric::LONG, value),
            Some(Value::Float(value)) => {
                self.tag(metric::FLOAT, wire::FOUR_BYTES);
                self.bytes(&value.to_le_bytes());
            }
            Some(Value::Double(value)) => {
                self.tag(metric::DOUBLE, wire::EIGHT_BYTES);
                self.bytes(&value.to_le_bytes());
            }
            Some(Value::Boolean(value)) => self.field(metric::BOOLEAN, value.into()),
            Some(Value::String(value)) => self.field_text(metric::STRING, value),
            None => {}
        }
    }

    fn quality(&mut self, quality: Quality) {
        self.field_text(properties::KEYS, &"Quality");
        self.field_of(properties::VALUES, |writer| {
            writer.field(properties::TYPE, DataType::Int32 as u64);
            writer.field(properties::INT, quality as u64);
        });
    }
}

/// The value of a field.
enum Field<'p> {
    Number(u64),
    EightBytes([u8; 8]),
    Bytes(&'p [u8]),
    FourBytes([u8; 4]),
}

impl<'p> Cursor<'p> {
    fn varint(&mut self) -> Result<u64, Malformed> {
        let mut number = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            number |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(number);
            }
        }
        Err(Malformed)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        self.bytes(N)?.first_chunk().copied().ok_or(Malformed)
    }

    /// The next field with its number; `None` at the end.
    fn field(&mut self) -> Result<Option<(u32, Field<'p>)>, Malformed> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let tag = u32::try_from(self.varint()?).map_err(|_| Malformed)?;
        let value = match tag & 7 {
            wire::VARINT => Field::Number(self.varint()?),
            wire::EIGHT_BYTES => Field::EightBytes(self.array()?),
            wire::MEASURED => {
                let count = usize::try_from(self.varint()?).map_err(|_| Malformed)?;
                Field::Bytes(self.bytes(count)?)
            }
            wire::FOUR_BYTES => Field::FourBytes(self.array()?),
            _ => return Err(Malformed),
        };
        Ok(Some((tag >> 3, value)))
    }
}

/// Calls `each` with the names and values of the metrics in the payload of a command. Those without a name, or with a value of another
/// type, are passed over. Of a payload that is cut `each` may have got a part.
pub(crate) fn metrics<'p>(
    payload: &'p [u8],
    each: &mut dyn FnMut(&'p str, Value<&'p str>),
) -> Result<(), Malformed> {
    let mut cursor = Cursor(payload);
    while let Some((number, field)) = cursor.field()? {
        if let (payload::METRICS, Field::Bytes(bytes)) = (number, field)
            && let (Some(name), Some(value)) = named_value(bytes)?
        {
            each(name, value);
        }
    }
    Ok(())
}

type NamedValue<'p> = (Option<&'p str>, Option<Value<&'p str>>);

fn named_value(bytes: &[u8]) -> Result<NamedValue<'_>, Malformed> {
    let text = |bytes| core::str::from_utf8(bytes).map_err(|_| Malformed);
    let (mut cursor, mut name, mut value, mut is_null) = (Cursor(bytes), None, None, false);
    while let Some((number, field)) = cursor.field()? {
        match (number, field) {
            (metric::NAME, Field::Bytes(bytes)) => name = Some(text(bytes)?),
            (metric::IS_NULL, Field::Number(number)) => is_null = number != 0,
            // A number of 32 bits may come with its sign in all 64.
            (metric::INT, Field::Number(number)) => value = Some(Value::Int(number as u32)),
            (metric::LONG, Field::Number(number)) => value = Some(Value::Long(number)),
            (metric::FLOAT, Field::FourBytes(bytes)) => value = Some(Value::Float(f32::from_le_bytes(bytes))),
            (metric::DOUBLE, Field::EightBytes(bytes)) => {
                value = Some(Value::Double(f64::from_le_bytes(bytes)))
            }
            (metric::BOOLEAN, Field::Number(number)) => value = Some(Value::Boolean(number != 0)),
            (metric::STRING, Field::Bytes(bytes)) => value = Some(Value::String(text(bytes)?)),
            _ => {}
        }
    }
    Ok((name, value.filter(|_| !is_null)))
}
