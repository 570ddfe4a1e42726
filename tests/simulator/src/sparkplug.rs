//! A host of Sparkplug B 3.0, as far as it reads payloads and writes commands; written from the specification's protobuf schema (6.4.1) and
//! not from the gateway's codec.

/// The value of a metric.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Of up to 32 bits.
    Int(u32),
    /// Of 64 bits.
    Long(u64),
    /// A float.
    Float(f32),
    /// A longer one.
    Double(f64),
    /// A bit.
    Boolean(bool),
    /// Text.
    Text(String),
}

/// A metric.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Metric {
    /// Its name.
    pub name: String,
    /// Milliseconds since 1970.
    pub timestamp: Option<u64>,
    /// The number of its type.
    pub datatype: Option<u64>,
    /// Whether it says that it has no value.
    pub is_null: bool,
    /// The property Quality.
    pub quality: Option<u64>,
    /// Its value.
    pub value: Option<Value>,
}

/// A payload.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Payload {
    /// Milliseconds since 1970.
    pub timestamp: Option<u64>,
    /// Its number.
    pub seq: Option<u64>,
    /// The metrics.
    pub metrics: Vec<Metric>,
}

/// A field with its number.
enum Field {
    Number(u64),
    Bytes(Vec<u8>),
}

fn number(bytes: &mut &[u8]) -> u64 {
    let mut value = 0;
    for shift in 0..10 {
        let (byte, rest) = bytes.split_first().expect("the end of a number");
        *bytes = rest;
        value |= u64::from(byte & 127) << (7 * shift);
        if *byte < 128 {
            return value;
        }
    }
    panic!("a number of more than ten bytes");
}

fn fields(mut bytes: &[u8]) -> Vec<(u64, Field)> {
    let mut fields = Vec::new();
    while !bytes.is_empty() {
        let tag = number(&mut bytes);
        let count = match tag % 8 {
            0 => {
                fields.push((tag / 8, Field::Number(number(&mut bytes))));
                continue;
            }
            1 => 8,
            2 => number(&mut bytes) as usize,
            5 => 4,
            other => panic!("a field of type {other}"),
        };
        let (own, rest) = bytes.split_at(count);
        fields.push((tag / 8, Field::Bytes(own.to_vec())));
        bytes = rest;
    }
    fields
}

fn text(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).expect("text")
}

/// The value of the only property there is: its name, its type 3 (Int32) and its value.
fn quality(bytes: &[u8]) -> u64 {
    match &fields(bytes)[..] {
        [(1, Field::Bytes(key)), (2, Field::Bytes(value))] => {
            assert_eq!(key, b"Quality");
            match fields(value)[..] {
                [(1, Field::Number(3)), (3, Field::Number(quality))] => quality,
                _ => panic!("a quality that is no Int32: {value:?}"),
            }
        }
        _ => panic!("other properties: {bytes:?}"),
    }
}

impl Metric {
    fn of(bytes: &[u8]) -> Self {
        let mut metric = Self::default();
        for (number, field) in fields(bytes) {
            match (number, field) {
                (1, Field::Bytes(name)) => metric.name = text(name),
                (3, Field::Number(timestamp)) => metric.timestamp = Some(timestamp),
                (4, Field::Number(datatype)) => metric.datatype = Some(datatype),
                (7, Field::Number(is_null)) => metric.is_null = is_null == 1,
                (9, Field::Bytes(bytes)) => metric.quality = Some(quality(&bytes)),
                (10, Field::Number(value)) => metric.value = Some(Value::Int(value.try_into().unwrap())),
                (11, Field::Number(value)) => metric.value = Some(Value::Long(value)),
                (12, Field::Bytes(bytes)) => {
                    metric.value = Some(Value::Float(f32::from_le_bytes(bytes.try_into().unwrap())));
                }
                (13, Field::Bytes(bytes)) => {
                    metric.value = Some(Value::Double(f64::from_le_bytes(bytes.try_into().unwrap())));
                }
                (14, Field::Number(value)) => metric.value = Some(Value::Boolean(value == 1)),
                (15, Field::Bytes(bytes)) => metric.value = Some(Value::Text(text(bytes))),
                (other, _) => panic!("a metric with field {other}"),
            }
        }
        assert!(metric.is_null == metric.value.is_none(), "a value or null: {metric:?}");
        metric
    }
}

impl Payload {
    /// Reads a payload; it must be one.
    pub fn of(bytes: &[u8]) -> Self {
        let mut payload = Self::default();
        for (number, field) in fields(bytes) {
            match (number, field) {
                (1, Field::Number(timestamp)) => payload.timestamp = Some(timestamp),
                (2, Field::Bytes(bytes)) => payload.metrics.push(Metric::of(&bytes)),
                (3, Field::Number(seq)) => payload.seq = Some(seq),
                (other, _) => panic!("a payload with field {other}"),
            }
        }
        payload
    }

    /// The metric of this name.
    pub fn metric(&self, name: &str) -> Option<&Metric> {
        self.metrics.iter().find(|metric| metric.name == name)
    }

    /// The names in order.
    pub fn names(&self) -> Vec<&str> {
        self.metrics.iter().map(|metric| metric.name.as_str()).collect()
    }
}

fn put(into: &mut Vec<u8>, mut number: u64) {
    while number > 127 {
        into.push(number as u8 | 128);
        number /= 128;
    }
    into.push(number as u8);
}

fn put_bytes(into: &mut Vec<u8>, field: u64, bytes: &[u8]) {
    put(into, 8 * field + 2);
    put(into, bytes.len() as u64);
    into.extend(bytes);
}

/// A command that sets metrics to these values.
pub fn command(values: &[(&str, Value)]) -> Vec<u8> {
    let mut payload = vec![8, 1];
    for (name, value) in values {
        let mut metric = Vec::new();
        put_bytes(&mut metric, 1, name.as_bytes());
        match value {
            Value::Int(value) => {
                metric.push(10 * 8);
                put(&mut metric, u64::from(*value));
            }
            Value::Long(value) => {
                metric.push(11 * 8);
                put(&mut metric, *value);
            }
            Value::Float(value) => {
                metric.push(12 * 8 + 5);
                metric.extend(value.to_le_bytes());
            }
            Value::Double(value) => {
                metric.push(13 * 8 + 1);
                metric.extend(value.to_le_bytes());
            }
            Value::Boolean(value) => metric.extend([14 * 8, u8::from(*value)]),
            Value::Text(value) => put_bytes(&mut metric, 15, value.as_bytes()),
        }
        put_bytes(&mut payload, 2, &metric);
    }
    payload
}
