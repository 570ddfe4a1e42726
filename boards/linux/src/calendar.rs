//! Dates: the machine's calendar for what the gateway's clock, which never jumps, has noted.

use std::time::SystemTime;

use embassy_time::Instant;
use jiff::{SignedDuration, Timestamp};
use mobgate::gateway::date::Date;

/// The date of now, with which those of certificates are compared.
pub fn now() -> SystemTime {
    Timestamp::now().into()
}

/// The date of `at` by the calendar of now.
pub fn date(at: Instant) -> Timestamp {
    let age = Instant::now().saturating_duration_since(at).as_micros();
    let age = SignedDuration::from_micros(i64::try_from(age).unwrap_or(i64::MAX));
    Timestamp::now().checked_sub(age).unwrap_or(Timestamp::UNIX_EPOCH)
}

/// The same for the gateway, which needs to know whether there is a calendar.
pub fn known(at: Instant) -> Option<Date> {
    u64::try_from(date(at).as_microsecond()).ok().map(Date)
}
