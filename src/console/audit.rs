//! `show audit`: the audit trail, then how it is forwarded.

use core::fmt;

use super::layout::Columns;
use super::output::Written;
use super::rows::{StatusText, age};
use super::table::{Source, titled};
use crate::gateway::audit::Forwarding;
use crate::hal::System;

const AUDIT: &str = "TIME\tWHO\tWHAT";
pub(super) const COLUMNS: Columns = &[20, 21];

/// The row at `place`: lines from the oldest on. A time is an age where there is no calendar.
pub(super) fn row(
    source: &Source<'_, '_>,
    system: &dyn System,
    place: usize,
    out: &mut dyn fmt::Write,
) -> Written {
    let Source { gateway, settings, now } = *source;
    if place == 0 {
        gateway.settle_audit();
    }
    titled(AUDIT, place, out, |nth, out| {
        let Some(line) = gateway.audit_line(nth) else {
            let is_behind = nth == 0 || gateway.audit_line(nth - 1).is_some();
            let syslog = settings.syslog().filter(|_| is_behind)?;
            let Forwarding { sent, lost, status } = gateway.forwarding();
            let status = StatusText(status);
            return Some(write!(out, "-\tsyslog\t{syslog}: {status}; last sent {sent}, {lost} lost"));
        };
        let dated = system.write_date(line.at, out);
        let dated = dated.unwrap_or_else(|| write!(out, "{}", age(line.at, now)));
        Some(dated.and_then(|()| write!(out, "\t{}", line.text)))
    })
}
