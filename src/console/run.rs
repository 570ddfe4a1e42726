//! What a command does.

use super::job::Job;
use super::session::Session;
use super::wait::Wait;
use crate::language::{Verb, Words, Wrong};
use crate::settings::Role;

/// Starts a command with its words. A command of several steps becomes the job.
pub(super) type Run = for<'g> fn(&mut Session<'_, 'g>, &Words<'_>, &mut Job<'g>) -> Result<Wait, Wrong>;

/// A command of the console.
pub(super) const fn command(role: Role, help: &'static str, run: Run) -> Verb<Run> {
    Verb::new(role, help, run)
}
