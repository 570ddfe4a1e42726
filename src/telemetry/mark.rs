//! What is known of a point: its value and quality at one time, and whether that is to be sent.

use embassy_time::{Duration, Instant};

use crate::scanner::{RowId, Scanner, Status};

/// How good a value is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quality {
    /// It was read, and reading goes on.
    Good,
    /// It was written, and is not read.
    Written,
    /// It was read, but the device has not responded since, or is not asked any more.
    Stale,
    /// It was never read.
    Unknown,
}

impl Quality {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Written => "written",
            Self::Stale => "stale",
            Self::Unknown => "unknown",
        }
    }
}

/// A value at one time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) quality: Quality,
    /// When it was read.
    pub(super) read: Option<Instant>,
    /// Whether the memory has what the device has: not a value that is still to be written.
    pub(super) is_known: bool,
    /// Tells values apart.
    sum: u64,
}

/// What was sent last of a point, or is to be sent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mark {
    pub(super) waits: bool,
    last: Option<(u64, Quality)>,
    sent: Instant,
}

impl Mark {
    /// Of a point that was never sent.
    pub(super) const NEW: Self = Self { waits: true, last: None, sent: Instant::MIN };

    /// Notes that the value of `sample` is sent.
    pub(super) fn sent(&mut self, sample: &Sample, now: Instant) {
        *self = Self { waits: false, last: Some((sample.sum, sample.quality)), sent: now };
    }

    /// Notes what the value is now. Returns whether that replaces one that was not sent.
    pub(super) fn update(&mut self, sample: &Sample, now: Instant, every: Duration) -> bool {
        let new = (sample.sum, sample.quality);
        let is_other = self.last != Some(new);
        let replaces = self.waits && self.last.is_some_and(|(sum, _)| sum != sample.sum);
        self.last = Some(new);
        self.waits |= is_other || now.saturating_duration_since(self.sent) >= every;
        replaces
    }
}

/// FNV-1a.
fn sum(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

/// The value of a row at `now`; `None` while the value is being written: it is known soon.
pub(super) fn sample(scanner: &Scanner, id: RowId, now: Instant) -> Option<Sample> {
    let shown = scanner.row(id)?;
    let row = shown.of.map_or(Some(shown), |of| scanner.row(of))?;
    let (status, age) = (scanner.status(id, now), scanner.age(id, now));
    let period = row.read.period();
    let writes = Status::WRITE_MARKED.with(Status::CURRENT_IS_WRITE).with(Status::WRITE_BLOCKED);
    let is_old = |age: Duration| period.is_some_and(|period| age > 3 * period + Duration::from_secs(1));
    let fails = status.any(Status::BACKING_OFF.with(Status::LAST_ERROR));
    // Until it is read again it is only what should be there.
    let is_own = row.device.is_some() && (status.any(writes) || status.any(Status::LAST_WAS_WRITE));
    let quality = match age {
        _ if row.device.is_none() && age.is_some() => Quality::Good,
        _ if is_own && !fails && period.is_none() => Quality::Written,
        None => Quality::Unknown,
        Some(age) if fails || is_old(age) => Quality::Stale,
        Some(_) => Quality::Good,
    };
    if is_own && !fails && (status.any(writes) || quality == Quality::Good) {
        return None;
    }
    let is_known = match quality {
        Quality::Good | Quality::Written => true,
        Quality::Stale => !is_own,
        Quality::Unknown => false,
    };
    let read = age.filter(|_| quality != Quality::Written).map(|age| now - age);
    let sum = if is_known { sum(scanner.input(id)) } else { 0 };
    Some(Sample { quality, read, is_known, sum })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_marked_when_it_changes_and_when_it_was_not_sent_for_long() {
        let every = Duration::from_secs(60);
        let at = |s| Instant::from_secs(s);
        let value = |sum| Sample { quality: Quality::Good, read: None, is_known: true, sum };
        let mut mark = Mark::NEW;
        assert!(!mark.update(&value(1), at(1), every) && mark.waits);
        assert!(!mark.update(&value(1), at(1), every) && mark.waits);
        // Nobody has got it.
        assert!(mark.update(&value(2), at(2), every));
        mark.sent(&value(2), at(3));
        assert!(!mark.update(&value(2), at(4), every) && !mark.waits);
        assert!(!mark.update(&value(3), at(5), every) && mark.waits);
        mark.sent(&value(3), at(5));
        assert!(!mark.update(&value(3), at(64), every) && !mark.waits);
        assert!(!mark.update(&value(3), at(65), every) && mark.waits);
        mark.sent(&value(3), at(65));
        let stale = Sample { quality: Quality::Stale, ..value(3) };
        assert!(!mark.update(&stale, at(66), every) && mark.waits);
    }
}
