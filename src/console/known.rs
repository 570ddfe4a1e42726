//! Name, help and completion of a command, of the console or of the settings' language.

use crate::language::{Offer, Verb};
use crate::settings::Role;

#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    pub(super) name: &'static str,
    pub(super) help: &'static str,
    pub(super) second: &'static [Offer],
    pub(super) later: &'static [Offer],
    /// The least role that may run it.
    pub(super) role: Role,
    /// Whether the image has it.
    pub(super) exists: bool,
}

impl Known {
    pub(super) fn new<Run>((name, verb): &(&'static str, Verb<Run>)) -> Self {
        let Verb { help, second, later, lacks, role, .. } = verb;
        Self { name, help, second, later, role: *role, exists: lacks.is_none() }
    }
}
