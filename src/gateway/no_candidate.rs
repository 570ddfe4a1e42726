//! Stub for the candidate, without the feature `candidate`.

use super::reconfigure::Unchanged;
use crate::language::Warning;

/// There is none.
pub struct Candidate(());

impl Candidate {
    pub(crate) fn is_open(&self) -> bool {
        false
    }

    pub(crate) fn is_waiting(&self) -> bool {
        false
    }

    pub(crate) fn settle(&self) {}

    pub(crate) fn change(&self, _line: &str) -> Option<Result<Option<Warning>, Unchanged>> {
        None
    }
}
