//! How settings differ as lines: for the audit trail, and for `diff`.
//!
//! Both walk through the lines of the old and the new settings and compare checksums, which include all secrets: a changed password
//! is a changed line, but is not shown. A rule that moves is one line removed and one added.

use core::fmt;

use heapless::{String, Vec};

use super::audit::{Actor, Topic};
use crate::gateway::Gateway;
use crate::language::{Shown, write_shown_line};
use crate::scanner::DEVICES_MAX;
use crate::settings::{
    AUDIT, CERTIFICATES_MAX, LINE_BYTES_MAX, POINTS_MAX, PORTS_MAX, PUBLISHERS_MAX, ROUTES_MAX, SERVERS_MAX,
    SLAVES_MAX, Settings, USER_KEYS_MAX, USERS_MAX,
};

/// Lines of settings: network, discovery, syslog and time have one each.
const LINES_MAX: usize = if AUDIT || cfg!(feature = "candidate") {
    USERS_MAX * (1 + USER_KEYS_MAX)
        + 4
        + CERTIFICATES_MAX
        + PUBLISHERS_MAX
        + PORTS_MAX
        + SERVERS_MAX
        + ROUTES_MAX
        + DEVICES_MAX
        + POINTS_MAX
        + SLAVES_MAX
} else {
    0
};

/// Most lines listed for one change.
const TOLD_MAX: usize = 64;

/// The check sum of a line (FNV-1a), whatever its columns are.
struct Sum {
    sum: u64,
    behind_blank: bool,
}

impl fmt::Write for Sum {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            let is_blank = byte == b' ';
            if !(is_blank && self.behind_blank) {
                self.sum = (self.sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
            }
            self.behind_blank = is_blank;
        }
        Ok(())
    }
}

/// The sums of all lines of `settings`, with those of secrets.
fn sums(settings: &Settings) -> Vec<u64, LINES_MAX> {
    let line = |n| {
        let mut sum = Sum { sum: 0xcbf2_9ce4_8422_2325, behind_blank: false };
        write_shown_line(settings, n, Shown::WithSecrets, &mut sum).map(|_| sum.sum)
    };
    (0..LINES_MAX).map_while(line).collect()
}

/// A line of settings.
type Line = String<LINE_BYTES_MAX>;

/// Line `n` of `settings` by itself, without secrets.
fn line(settings: &Settings, n: usize) -> Line {
    let mut line = Line::new();
    // Fits, see LINE_BYTES_MAX.
    let _ = write_shown_line(settings, n, Shown::Apart, &mut line);
    line
}

/// Position in the lines of the old and the new settings.
#[derive(Debug, Clone, Default)]
pub(crate) struct Difference {
    old: usize,
    new: usize,
}

impl Difference {
    /// The next line that differs: a `-` is in the old settings alone, a `+` in the new ones.
    // Without a candidate there is no `diff`.
    #[cfg(feature = "candidate")]
    pub(crate) fn next(&mut self, old: &Settings, new: &Settings) -> Option<(char, Line)> {
        let (sign, n) = self.advance(&sums(old), &sums(new))?;
        Some((sign, line(if sign == '-' { old } else { new }, n)))
    }

    /// The same with the number of the line.
    fn advance(&mut self, was: &[u64], is: &[u64]) -> Option<(char, usize)> {
        let has = |sums: &[u64], from: usize, sum: u64| sums.iter().skip(from).any(|other| *other == sum);
        loop {
            let (old, new) = (self.old, self.new);
            match (was.get(old).copied(), is.get(new).copied()) {
                (Some(gone), Some(came)) if gone == came => {
                    self.old += 1;
                    self.new += 1;
                }
                // Removed lines first, then added ones.
                (Some(gone), came) if !has(is, new, gone) || came.is_some_and(|came| has(was, old, came)) => {
                    self.old += 1;
                    return Some(('-', old));
                }
                (_, Some(_)) => {
                    self.new += 1;
                    return Some(('+', new));
                }
                (_, None) => return None,
            }
        }
    }
}

impl Gateway<'_> {
    /// Writes a line for each line of the settings that `new` adds or takes away.
    pub fn audit_difference(&self, actor: Actor<'_>, new: &Settings) {
        if !AUDIT {
            return;
        }
        self.settings(|old| {
            let (was, is) = (sums(old), sums(new));
            let (mut difference, mut told) = (Difference::default(), 0);
            while let Some((sign, n)) = difference.advance(&was, &is) {
                told += 1;
                if told <= TOLD_MAX {
                    let line = line(if sign == '-' { old } else { new }, n);
                    self.audit(Topic::Settings, actor, format_args!("{sign} {line}"));
                }
            }
            if told > TOLD_MAX {
                let more = told - TOLD_MAX;
                self.audit(Topic::Settings, actor, format_args!("{more} more lines differ"));
            }
        });
    }
}
