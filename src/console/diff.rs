//! `show candidate`, and `diff`: how it differs from the settings in force.

use core::fmt::{self, Write as _};

use heapless::String;

use super::output::Written;
use super::session::Session;
use super::table::Source;
use super::wait::Wait;
use crate::gateway::Candidate;
use crate::language::{Shown, write_shown_line};
use crate::settings::{LINE_BYTES_MAX, PORTS_MAX, PortId, Settings};

/// A line of settings.
type Line = String<LINE_BYTES_MAX>;

/// Line `n` of `settings`.
fn line(settings: &Settings, n: usize) -> Option<Line> {
    let mut line = Line::new();
    // Fits, see LINE_BYTES_MAX.
    let _ = write_shown_line(settings, n, Shown::Apart, &mut line)?;
    Some(line)
}

/// Whether `wanted` is one of the lines of `settings` from line `n` on.
fn has(settings: &Settings, n: usize, wanted: &Line) -> bool {
    (n..).map_while(|n| line(settings, n)).any(|line| line == *wanted)
}

/// The lines that differ, in the order of the settings: a `-` is in force and not in the candidate, a `+` the other way round. A
/// rule that moves is both.
#[derive(Debug, Default)]
pub(super) struct Diff {
    /// The next line in force, and of the candidate.
    old: usize,
    new: usize,
    /// Whether they are at their end.
    ended: bool,
}

impl Diff {
    /// Shows the next line.
    pub(super) fn step(&mut self, session: &mut Session<'_, '_>) -> Wait {
        let gateway = session.gateway;
        let Some(Ok(candidate)) = gateway.candidate().map(Candidate::settings) else { return Wait::End };
        if self.ended {
            gateway.settings(|in_force| restarts(session, in_force, &candidate));
            return Wait::End;
        }
        match gateway.settings(|in_force| self.next(in_force, &candidate)) {
            Some((sign, line)) => session.out.line(format_args!("{sign} {line}")),
            None => self.ended = true,
        }
        Wait::Sent
    }

    fn next(&mut self, in_force: &Settings, candidate: &Settings) -> Option<(char, Line)> {
        loop {
            match (line(in_force, self.old), line(candidate, self.new)) {
                (None, None) => return None,
                (Some(old), Some(new)) if old == new => {
                    self.old += 1;
                    self.new += 1;
                }
                // A line that the candidate has nowhere is taken out first; then one that it has before others is put in.
                (Some(old), new) if new.is_none() || !has(candidate, self.new, &old) => {
                    self.old += 1;
                    return Some(('-', old));
                }
                (Some(old), Some(new)) if has(in_force, self.old, &new) => {
                    self.old += 1;
                    return Some(('-', old));
                }
                (_, Some(new)) => {
                    self.new += 1;
                    return Some(('+', new));
                }
                (Some(_), None) => return None,
            }
        }
    }
}

/// Says which ports end or restart.
fn restarts(session: &mut Session<'_, '_>, in_force: &Settings, candidate: &Settings) {
    let mut names = String::<{ PORTS_MAX * 20 }>::new();
    for index in 0..PORTS_MAX {
        let id = PortId(index as u8);
        let named = in_force.port(id).or(candidate.port(id)).filter(|_| in_force.restarts(candidate, id));
        if let Some(port) = named {
            // Names have 15 bytes at most.
            let _ = write!(names, " {}", port.name);
        }
    }
    if !names.is_empty() {
        session.out.line(format_args!("restarts:{names}"));
    }
}

/// `show candidate`
pub(super) fn row(source: &Source<'_, '_>, place: usize, out: &mut dyn fmt::Write) -> Written {
    let candidate = source.gateway.candidate()?;
    match candidate.remaining(source.now).filter(|_| place == 0) {
        Some(time) => {
            Some(write!(out, "# none: a commit waits for its confirmation for another {}s", time.as_secs()))
        }
        None => {
            let settings = candidate.settings().ok()?;
            write_shown_line(&settings, place, Shown::WithoutSecrets, out)
        }
    }
}
