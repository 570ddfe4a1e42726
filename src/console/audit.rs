//! `show audit`: the audit trail, then how it is forwarded.

use core::fmt;

use super::layout::Columns;
use super::output::Written;
use super::rows::StatusText;
use super::table::{Source, titled};
use crate::gateway::audit::{AuditLine, Forwarding, Stamp};
use crate::hal::System;

const AUDIT: &str = "TIME\tWHO\tWHAT";
pub(super) const COLUMNS: Columns = &[20, 21];

/// The row at `place`, oldest line first. Without a calendar, times count from the start of the gateway.
pub(super) fn row(
    source: &Source<'_, '_>,
    system: &dyn System,
    place: usize,
    out: &mut dyn fmt::Write,
) -> Written {
    let Source { gateway, settings, .. } = *source;
    if place == 0 {
        gateway.settle_audit();
    }
    titled(AUDIT, place, out, |nth, out| {
        let earlier = gateway.earlier_audit();
        let is_earlier = |nth| gateway.audit_line(nth).is_some_and(|line| line.number <= earlier);
        let nth = match nth.checked_sub(1) {
            // Between the lines of earlier runs and those of this one.
            Some(last) if is_earlier(last) && !is_earlier(nth) => {
                return Some(out.write_str("-\tgateway\tabove: before the last start"));
            }
            Some(last) if !is_earlier(nth) && is_earlier(0) => last,
            _ => nth,
        };
        let Some(line) = gateway.audit_line(nth) else {
            let is_behind = nth == 0 || gateway.audit_line(nth - 1).is_some();
            let syslog = settings.syslog().filter(|_| is_behind)?;
            let Forwarding { sent, lost, status } = gateway.forwarding();
            let status = StatusText(status);
            return Some(write!(out, "-\tsyslog\t{syslog}: {status}; last sent {sent}, {lost} lost"));
        };
        Some(write_time(&line, system, out).and_then(|()| write!(out, "\t{}", line.text)))
    })
}

fn write_time(line: &AuditLine, system: &dyn System, out: &mut dyn fmt::Write) -> fmt::Result {
    match line.stamp {
        Stamp::Date(date) => write!(out, "{date}"),
        Stamp::Up(at) => system.write_date(at, out).unwrap_or_else(|| write!(out, "up {}s", at.as_secs())),
    }
}
