//! A line of the audit trail.

use heapless::String;

use super::stamp::Stamp;
use super::topic::Topic;
use crate::settings::LINE_BYTES_MAX;

/// Longest text of a line in bytes: a line of settings, and who typed it. Longer ones end in `...`.
pub const AUDIT_BYTES_MAX: usize = LINE_BYTES_MAX + 100;

/// A line of the audit trail.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AuditLine {
    /// Consecutive, from 1.
    pub number: u32,
    /// When it was written.
    pub stamp: Stamp,
    /// Its topic.
    pub topic: Topic,
    /// Who, a tab, and what.
    pub text: String<AUDIT_BYTES_MAX>,
}

impl AuditLine {
    /// Its actor.
    pub fn actor(&self) -> &str {
        self.text.split_once('\t').map_or("", |(actor, _)| actor)
    }

    /// What happened.
    pub fn what(&self) -> &str {
        self.text.split_once('\t').map_or("", |(_, what)| what)
    }
}
