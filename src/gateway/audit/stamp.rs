//! When a line of the audit trail was written.

use embassy_time::Instant;

use crate::gateway::date::Date;

/// The time of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stamp {
    /// By the clock of the run that wrote it, which may be an earlier one.
    Up(Instant),
    /// By the calendar.
    Date(Date),
}

/// Set in the number of a date.
const IS_DATE: u64 = 1 << 63;

impl Stamp {
    /// As it is kept in a ring.
    pub(super) fn number(self) -> u64 {
        match self {
            Self::Up(at) => at.as_ticks() & !IS_DATE,
            Self::Date(Date(us)) => us | IS_DATE,
        }
    }

    pub(super) fn of(number: u64) -> Self {
        if number & IS_DATE == 0 {
            Self::Up(Instant::from_ticks(number))
        } else {
            Self::Date(Date(number & !IS_DATE))
        }
    }
}
