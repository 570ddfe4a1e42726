//! What new settings change, as lines of the settings: for the audit trail.

use core::fmt;

use heapless::Vec;

use super::{Actor, Topic};
use crate::gateway::Gateway;
use crate::language::{Shown, write_shown_line};
use crate::scanner::DEVICES_MAX;
use crate::settings::{
    LINE_BYTES_MAX, POINTS_MAX, PORTS_MAX, ROUTES_MAX, SERVERS_MAX, SLAVES_MAX, Settings, USERS, USERS_MAX,
};

/// Lines of settings: network, discovery and syslog have one each.
const LINES_MAX: usize = if USERS {
    USERS_MAX + 3 + PORTS_MAX + SERVERS_MAX + ROUTES_MAX + DEVICES_MAX + POINTS_MAX + SLAVES_MAX
} else {
    0
};

/// Lines told of one change.
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

impl Gateway<'_> {
    /// Writes a line for each line of the settings that `new` adds or takes away.
    pub fn audit_difference(&self, actor: Actor<'_>, new: &Settings) {
        if !USERS {
            return;
        }
        self.settings(|old| {
            let (was, is) = (sums(old), sums(new));
            let mut told = 0;
            self.tell_lines(actor, "-", old, &was, &is, &mut told);
            self.tell_lines(actor, "+", new, &is, &was, &mut told);
            if told > TOLD_MAX {
                let more = told - TOLD_MAX;
                self.audit(Topic::Settings, actor, format_args!("{more} more lines differ"));
            } else if told == 0 && *old != *new {
                self.audit(Topic::Settings, actor, format_args!("the order of the lines is another"));
            }
        });
    }

    /// Writes the lines of `settings` whose sums are not among `others`.
    fn tell_lines(
        &self,
        actor: Actor<'_>,
        sign: &str,
        settings: &Settings,
        sums: &[u64],
        others: &[u64],
        told: &mut usize,
    ) {
        for (n, _) in sums.iter().enumerate().filter(|(_, sum)| !others.contains(sum)) {
            *told += 1;
            let mut line = heapless::String::<LINE_BYTES_MAX>::new();
            if *told <= TOLD_MAX && write_shown_line(settings, n, Shown::WithoutSecrets, &mut line).is_some()
            {
                self.audit(Topic::Settings, actor, format_args!("{sign} {line}"));
            }
        }
    }
}
