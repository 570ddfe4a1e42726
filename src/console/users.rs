//! `show users`: users and their roles.

use core::fmt;

use super::layout::Columns;
use super::output::Written;
use super::table::Source;
use crate::settings::{SSH, User};

pub(super) const HEAD: &str = if SSH { "NAME\tROLE\tPASSWORD\tKEYS" } else { "NAME\tROLE\tPASSWORD" };
/// The widths of the columns.
pub(super) const COLUMNS: Columns = if SSH { &[15, 8, 21, -4] } else { &[15, 8] };

/// User `nth`, without secrets.
pub(super) fn row(source: &Source<'_, '_>, nth: usize, out: &mut dyn fmt::Write) -> Written {
    let User { name, role, password, keys } = source.settings.users.get(nth)?;
    let password = match password {
        Some(_) => "set",
        None if SSH && !keys.is_empty() => "none",
        None => "none: cannot log in",
    };
    if SSH {
        return Some(write!(out, "{name}\t{role}\t{password}\t{}", keys.len()));
    }
    Some(write!(out, "{name}\t{role}\t{password}"))
}
