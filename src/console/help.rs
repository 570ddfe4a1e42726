//! The output of `help`.

use core::str::Lines;

use super::known::Known;
use super::show::{Show, TOPICS};
use crate::settings::Role;

/// Columns of the syntax, where its meaning follows.
pub(super) const TYPED_COLUMNS: usize = 29;

/// The remaining lines.
#[derive(Debug, Clone)]
pub(super) enum Help {
    /// The first lines of all commands of a role, by index, from an index on.
    Overview(fn(usize) -> Option<Known>, Role, usize),
    /// These lines, then these topics.
    Topic(Lines<'static>, &'static [(&'static str, (Show, &'static str))]),
}

impl Help {
    /// Of all commands that `role` may run.
    pub(super) fn overview(known: fn(usize) -> Option<Known>, role: Role) -> Self {
        Self::Overview(known, role, 0)
    }

    /// The text about a command.
    pub(super) fn of(Known { name, help, .. }: Known) -> Self {
        Self::Topic(help.lines(), if name == "show" { TOPICS } else { &[] })
    }

    /// The next line: syntax and meaning.
    pub(super) fn next(&mut self) -> Option<(&'static str, &'static str)> {
        let line = match self {
            Self::Topic(lines, topics) => match lines.next() {
                Some(line) => line,
                None => {
                    let ((name, (_, does)), rest) = topics.split_first()?;
                    *topics = rest;
                    return Some((name, does));
                }
            },
            Self::Overview(known, role, at) => loop {
                let command = known(*at)?;
                *at += 1;
                if command.exists && command.role <= *role {
                    break command.help.lines().next()?;
                }
            },
        };
        Some(line.split_once('\t').unwrap_or((line, "")))
    }
}
