//! `show publishers`: the brokers that get the data points, and how each one does.

use core::fmt;

use super::layout::Columns;
use super::output::Written;
use super::rows::{StatusText, age, text};
use super::table::Source;
use crate::gateway::Status;

pub(super) const HEAD: &str = "PUBLISHER\tBROKER\tSINCE\tSENT\tQUEUED\tLOST\tSTATUS";
pub(super) const COLUMNS: Columns = &[15, 21, -9, -10, -6, -6];

/// Publisher `nth`.
pub(super) fn row(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let Source { gateway, settings, now } = *source;
    let publisher = settings.publishers.get(nth)?;
    let report = gateway.publisher(nth)?.report(|_| {});
    let (name, broker, status) = (&publisher.name, &publisher.broker, StatusText(report.status));
    let since = match report.status {
        Status::Open => age(report.since, now),
        _ => text(format_args!("-")),
    };
    let (sent, queued, lost) = (report.sent, report.queued, report.lost);
    Some(write!(out, "{name}\t{broker}\t{since}\t{sent}\t{queued}\t{lost}\t{status}"))
}
