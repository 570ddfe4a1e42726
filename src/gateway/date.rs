//! Dates, as RFC 3339 writes them (and RFC 5424, whose time stamps they are).

use core::fmt;

use time::OffsetDateTime;

/// Microseconds since 1970 began, UTC. With a precision it is written with microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Date(pub u64);

/// Microseconds of a second.
const SECOND: u64 = 1_000_000;

impl fmt::Display for Date {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = i64::try_from(self.0 / SECOND).unwrap_or(i64::MAX);
        // Years of more than four digits.
        let Ok(at) = OffsetDateTime::from_unix_timestamp(seconds) else { return f.write_str("-") };
        let ((year, month, day), (hour, minute, second)) = (at.to_calendar_date(), at.to_hms());
        let month = u8::from(month);
        write!(f, "{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}")?;
        if f.precision().is_some() {
            write!(f, ".{:06}", self.0 % SECOND)?;
        }
        f.write_str("Z")
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::format;

    use super::Date;

    /// As GNU date writes them: `date -u -d @SECONDS +%FT%TZ`.
    #[test]
    fn dates_are_those_of_other_programs() {
        for (seconds, date) in [
            (0, "1970-01-01T00:00:00Z"),
            (951_827_696, "2000-02-29T12:34:56Z"),
            (1_795_680_902, "2026-11-26T08:15:02Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(format!("{}", Date(seconds * 1_000_000 + 999_999)), date);
        }
        assert_eq!(format!("{:.6}", Date(1_795_680_902_000_450)), "2026-11-26T08:15:02.000450Z");
        assert_eq!(format!("{}", Date(u64::MAX)), "-");
    }
}
