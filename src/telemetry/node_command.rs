//! Commands of Sparkplug hosts: another birth certificate, and values to write.

use core::fmt::Write;

use heapless::String;

use super::answer::Outcome;
use super::command::refusal;
use super::metrics::data_type;
use super::session::Session;
use super::source::Source;
use crate::console::Refusal;
use crate::mqtt::Reply;
use crate::mqtt::sparkplug::{DataType, REBIRTH, Value, metrics};
use crate::scanner::{RowId, TypedValue};
use crate::settings::{LINE_BYTES_MAX, PointName};

/// A value as it is typed at the console.
type Typed = String<LINE_BYTES_MAX>;

/// A whole number of 32 bits, as it is meant for a metric of this type.
fn whole(kind: DataType, number: u32) -> i64 {
    match kind {
        // Hosts extend the sign to 32 bits, or do not.
        DataType::Int16 => match u16::try_from(number) {
            Ok(short) => short.cast_signed().into(),
            Err(_) => number.cast_signed().into(),
        },
        DataType::Int32 | DataType::Int64 | DataType::Float | DataType::Double => number.cast_signed().into(),
        _ => number.into(),
    }
}

#[cfg(feature = "long-values")] // As values of 64 bits.
fn double(value: f64) -> TypedValue<'static> {
    TypedValue::Long(crate::scanner::LongValue::F64(value))
}

#[cfg(not(feature = "long-values"))]
fn double(value: f64) -> TypedValue<'static> {
    TypedValue::Fraction(value as f32)
}

/// The text of a value for a metric of this type; `None` if it is too long, or a text for a number.
fn typed(kind: DataType, value: Value<&str>) -> Option<Typed> {
    let mut text = Typed::new();
    let written = match value {
        Value::Boolean(value) => write!(text, "{}", u8::from(value)),
        Value::Int(number) => write!(text, "{}", whole(kind, number)),
        Value::Long(number) if kind == DataType::UInt64 => write!(text, "{number}"),
        Value::Long(number) => write!(text, "{}", number.cast_signed()),
        Value::Float(value) => write!(text, "{}", TypedValue::Fraction(value)),
        Value::Double(value) => write!(text, "{}", double(value)),
        Value::String(value) if kind == DataType::String => text.write_str(value),
        Value::String(_) => return None,
    };
    written.ok().map(|()| text)
}

impl Source<'_, '_> {
    /// Does what a command says. A retained one is of before, and does nothing.
    pub(super) fn node_command(&self, session: &mut Session, payload: &[u8], retained: bool) {
        if retained {
            return;
        }
        // All of it or nothing.
        if metrics(payload, &mut |_, _| {}).is_err() {
            log_warn!("publisher {}: a command is no payload of Sparkplug", self.publisher.name);
            return;
        }
        let _ = metrics(payload, &mut |name, value| {
            if name == REBIRTH {
                session.is_born &= value != Value::Boolean(true);
            } else if self.publisher.commands {
                self.write_metric(session, name, value);
            }
        });
    }

    fn write_metric(&self, session: &mut Session, metric: &str, value: Value<&str>) {
        let (name, number) = match metric.split_once('/') {
            Some((name, number)) => (name, Some(number)),
            None => (metric, None),
        };
        let Ok(point) = PointName::try_from(name) else {
            log_warn!("publisher {}: there is no metric of the name in a command", self.publisher.name);
            return;
        };
        let begin = |name: &str| self.begin_metric(name, number, value);
        self.command(session, point, Reply::default(), begin);
    }

    fn begin_metric(&self, name: &str, number: Option<&str>, value: Value<&str>) -> Result<RowId, Refusal> {
        let known = self.gateway.settings(|settings| {
            let point = settings.points.get(usize::from(settings.find_point(name)?))?;
            let nth = number.and_then(|number| number.parse::<u16>().ok());
            let is_one = number.is_none() && point.count == 1;
            let is_of_several = point.count > 1 && nth.is_some_and(|nth| nth < point.count);
            (is_one || is_of_several).then(|| (data_type(point), nth))
        });
        let (kind, nth) = known.ok_or_else(|| refusal("there is no metric of this name"))?;
        let text = typed(kind, value).ok_or_else(|| refusal("expected a value of the metric's type"))?;
        self.write(name, nth, &text)
    }

    /// Sparkplug has no answers to commands.
    pub(super) fn log_answers(&self, session: &mut Session) {
        while let Some(answer) = session.answers.pop_front() {
            let why = match &answer.outcome {
                Outcome::Written => continue,
                Outcome::Refused(why) => why.as_str(),
                Outcome::Failed(why) => why,
                Outcome::Waits => "the device does not respond: it is written once it does",
            };
            log_warn!("publisher {}: command to {}: {}", self.publisher.name, answer.point, why);
        }
    }
}
