//! What messages carry, as JSON: `{"value":21.5,"quality":"good","time":"2026-11-27T16:22:42.123Z"}`.

use core::fmt::{self, Write};

use embassy_time::Instant;
use heapless::String;

use super::mark::Moment;
use super::source::Source;
use crate::gateway::audit::{AuditLine, Stamp};
use crate::language::json::Quoted;
use crate::scanner::{TypedValue, ValueType};
use crate::settings::PointSettings;

/// Longest date in bytes.
const DATE_BYTES_MAX: usize = 40;

impl Source<'_, '_> {
    /// The time `at`: a date in quotes, or seconds since the start on boards that do not know it.
    fn write_time(&self, at: Instant, out: &mut dyn Write) -> fmt::Result {
        if let Some(date) = self.gateway.date(at) {
            return write!(out, "\"{date:.6}\"");
        }
        let mut date = String::<DATE_BYTES_MAX>::new();
        match (self.write_date)(at, &mut date) {
            Some(written) => written.and_then(|()| write!(out, "\"{date}\"")),
            None => write!(out, "{}.{:03}", at.as_secs(), at.as_millis() % 1_000),
        }
    }

    /// A point's value with its quality and the time at which it was read.
    pub(super) fn write_value(
        &self,
        point: &PointSettings,
        cells: &[u8],
        moment: &Moment,
        out: &mut dyn Write,
    ) -> fmt::Result {
        out.write_str("{\"value\":")?;
        match point.count {
            _ if !moment.is_known => out.write_str("null")?,
            1 => write_one(point.value, cells, 0, out)?,
            count => {
                for nth in 0..count {
                    out.write_str(if nth == 0 { "[" } else { "," })?;
                    write_one(point.value, cells, nth.into(), out)?;
                }
                out.write_str("]")?;
            }
        }
        write!(out, ",\"quality\":\"{}\",\"time\":", moment.quality.name())?;
        match moment.read {
            Some(read) => self.write_time(read, out)?,
            None => out.write_str("null")?,
        }
        out.write_str("}")
    }

    /// A line of the audit trail that is an alarm.
    pub(super) fn write_alarm(&self, line: &AuditLine, out: &mut dyn Write) -> fmt::Result {
        write!(out, "{{\"number\":{},\"text\":{},\"time\":", line.number, Quoted(line.what()))?;
        match line.stamp {
            Stamp::Date(date) => write!(out, "\"{date:.6}\"")?,
            Stamp::Up(at) => self.write_time(at, out)?,
        }
        out.write_str("}")
    }
}

/// Value `nth`; JSON has no number for what is none, or infinite.
fn write_one(value: ValueType, cells: &[u8], nth: usize, out: &mut dyn Write) -> fmt::Result {
    if value == ValueType::Bit {
        let bit = cells.get(nth / 8).is_some_and(|byte| byte >> (nth % 8) & 1 == 1);
        return write!(out, "{}", u8::from(bit));
    }
    let at = 2 * usize::from(value.registers()) * nth;
    match value.take(cells.get(at..).unwrap_or_default()) {
        Some(TypedValue::Fraction(fraction)) if !fraction.is_finite() => out.write_str("null"),
        Some(value) => write!(out, "{value}"),
        None => out.write_str("null"),
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::String;

    use super::*;

    fn one(value: ValueType, cells: &[u8], nth: usize) -> String {
        let mut text = String::new();
        write_one(value, cells, nth, &mut text).unwrap();
        text
    }

    #[test]
    fn values_are_numbers_of_json() {
        assert_eq!(one(ValueType::Bit, &[0b10], 1), "1");
        assert_eq!(one(ValueType::I16, &[0, 1, 0xff, 0xfe], 1), "-2");
        assert_eq!(one(ValueType::F32, &21.5_f32.to_be_bytes(), 0), "21.5");
        assert_eq!(one(ValueType::F32, &f32::NAN.to_be_bytes(), 0), "null");
        assert_eq!(one(ValueType::F32, &f32::INFINITY.to_be_bytes(), 0), "null");
        assert_eq!(one(ValueType::U32, &[0, 0], 0), "null");
    }
}
