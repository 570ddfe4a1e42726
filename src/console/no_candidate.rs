//! Stub for the commands of a candidate, without the feature `candidate`.

use super::run::Run;
use crate::language::Verbs;

/// There are none.
pub(super) const COMMANDS: Verbs<Run> = &[];
