//! What `help` says.

use core::str::Lines;

use super::known::Known;
use super::show::{Show, TOPICS};

/// Columns for what is typed, where something stands behind it.
pub(super) const TYPED_COLUMNS: usize = 29;

/// What is left to say.
#[derive(Debug, Clone)]
pub(super) enum Help {
    /// The first lines of all commands, which this gives by their places, from a place on.
    Overview(fn(usize) -> Option<Known>, usize),
    /// These lines, and behind them these topics.
    Topic(Lines<'static>, &'static [(&'static str, (Show, &'static str))]),
}

impl Help {
    /// Of all commands.
    pub(super) fn overview(known: fn(usize) -> Option<Known>) -> Self {
        Self::Overview(known, 0)
    }

    /// The text about a command.
    pub(super) fn of(Known { name, help, .. }: Known) -> Self {
        Self::Topic(help.lines(), if name == "show" { TOPICS } else { &[] })
    }

    /// The next line: what is typed, and what it does.
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
            Self::Overview(known, at) => loop {
                let command = known(*at)?;
                *at += 1;
                if command.exists {
                    break command.help.lines().next()?;
                }
            },
        };
        Some(line.split_once('\t').unwrap_or((line, "")))
    }
}
