//! A time with its text form.

use core::fmt;

use embassy_time::Duration;

/// A time as the line language writes it: `0`, `750us`, `1.75ms`, `2s`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Time(pub Duration);

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let us = self.0.as_micros();
        match us {
            0 => f.pad("0"),
            _ if us.is_multiple_of(1_000_000) => write!(f, "{}s", us / 1_000_000),
            _ if us.is_multiple_of(1_000) => write!(f, "{}ms", us / 1_000),
            1..1_000 => write!(f, "{us}us"),
            _ => {
                let (mut fraction, mut digits) = (us % 1_000, 3);
                while fraction.is_multiple_of(10) {
                    (fraction, digits) = (fraction / 10, digits - 1);
                }
                write!(f, "{}.{fraction:0digits$}ms", us / 1_000)
            }
        }
    }
}
