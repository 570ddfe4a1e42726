//! Applies lines to the candidate, all or none.

use super::lines::Lines;
use super::untaken::Untaken;
use crate::gateway::commit::Uncommitted;
use crate::gateway::{Gateway, reconfigure};
use crate::language::apply;

/// Why nothing was changed.
// Passed on once, and there is no heap for the larger one.
#[allow(clippy::large_enum_variant)]
pub(super) enum Unchanged {
    Untaken(Untaken),
    Uncommitted(Uncommitted),
}

impl From<Uncommitted> for Unchanged {
    fn from(error: Uncommitted) -> Self {
        Self::Uncommitted(error)
    }
}

/// Applies `lines` to the candidate, or to an empty one if `replaces`; begins one if necessary.
/// Calls `warn` for likely mistakes. A user who keeps the name keeps the password, because that is never shown; so does a publisher
/// that keeps its name and its user.
pub(super) async fn change(
    gateway: &Gateway<'_>,
    lines: Lines<'_>,
    replaces: bool,
    warn: &mut dyn FnMut(usize, &crate::language::Warning),
) -> Result<usize, Unchanged> {
    let candidate = gateway.candidate().ok_or(Uncommitted::Nothing)?;
    // The draft is the place to try the lines in.
    let mut draft = reconfigure::draft(gateway).await;
    let begins = !candidate.is_open();
    if begins {
        candidate.begin(gateway)?;
    }
    let mut settings = candidate.settings()?;
    draft.clone_from(&settings);
    if replaces {
        draft.clear();
    }
    let mut count = 0;
    let taken = lines.each(&mut |number, line| {
        let applied = apply(&mut draft, line)?;
        count += usize::from(applied.changed);
        applied.warning.iter().for_each(|warning| warn(number, warning));
        Ok(())
    });
    if let Err(untaken) = taken {
        drop(settings);
        if begins {
            candidate.discard()?;
        }
        return Err(Unchanged::Untaken(untaken));
    }
    draft.keep_passwords(&settings);
    // A long text comes by pieces, of which the first one replaces the candidate.
    gateway.settings(|in_force| draft.keep_passwords(in_force));
    settings.clone_from(&draft);
    Ok(count)
}
