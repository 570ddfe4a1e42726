//! What messages carry, as JSON: `{"value":21.5,"quality":"good","time":"2026-11-27T16:22:42.123456Z"}`.

use core::fmt::{self, Write};

use embassy_time::Instant;

use super::mark::Sample;
use super::source::Source;
use crate::console::{Numbers, Values};
use crate::gateway::audit::{AuditLine, Stamp};
use crate::language::json::Quoted;
use crate::settings::PointSettings;

impl Source<'_, '_> {
    /// The time `at`: a date in quotes, or seconds since the start on boards that do not know it.
    fn write_time(&self, at: Instant, out: &mut dyn Write) -> fmt::Result {
        match self.date(at) {
            Some(date) => write!(out, "\"{date:.6}\""),
            None => write!(out, "{}.{:03}", at.as_secs(), at.as_millis() % 1_000),
        }
    }

    /// A point's value with its quality and the time at which it was read.
    pub(super) fn write_value(
        &self,
        point: &PointSettings,
        cells: &[u8],
        sample: &Sample,
        out: &mut dyn Write,
    ) -> fmt::Result {
        out.write_str("{\"value\":")?;
        let PointSettings { value, scale, .. } = *point;
        let values = Values { value, scale, cells, range: 0..point.count.into() };
        match point.count {
            _ if !sample.is_known => out.write_str("null")?,
            1 => values.write_json(0, out)?,
            _ => write!(out, "{}", Numbers(values))?,
        }
        write!(out, ",\"quality\":\"{}\",\"time\":", sample.quality.name())?;
        match sample.read {
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
