//! Virtual time: picoseconds since the emulator's beginning. It passes only by instructions and by waiting for events.

use std::time::Duration;

/// A moment, or a span.
pub(crate) type Time = u64;

/// Picoseconds of a second.
pub(crate) const SECOND: Time = 1_000_000_000_000;
/// Picoseconds of a nanosecond.
pub(crate) const NANOSECOND: Time = 1_000;
/// Picoseconds of a microsecond.
pub(crate) const MICROSECOND: Time = 1_000_000;

/// A span as the emulator counts it.
pub(crate) fn span(duration: Duration) -> Time {
    duration.as_nanos() as u64 * 1_000
}

/// A span or a moment as the standard library has it.
pub(crate) fn duration(time: Time) -> Duration {
    Duration::from_nanos(time / 1_000)
}
