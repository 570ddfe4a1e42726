//! `show candidate`, and `diff`: how it differs from the settings in force.

use core::fmt::{self, Write as _};

use heapless::String;

use super::output::Written;
use super::session::Session;
use super::table::Source;
use super::wait::Wait;
use crate::gateway::Candidate;
use crate::gateway::difference::Difference;
use crate::language::{Shown, write_shown_line};
use crate::settings::{PORTS_MAX, PortId, Settings};

/// The lines that differ, in the order of the settings: a `-` is in force and not in the candidate, a `+` the other way round.
#[derive(Debug, Default)]
pub(super) struct Diff {
    difference: Difference,
    /// All lines were shown.
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
        match gateway.settings(|in_force| self.difference.next(in_force, &candidate)) {
            Some((sign, line)) => session.out.line(format_args!("{sign} {line}")),
            None => self.ended = true,
        }
        Wait::Sent
    }
}

/// The names of the ports that end or restart.
pub(crate) fn restarting<'s>(
    in_force: &'s Settings,
    candidate: &'s Settings,
) -> impl Iterator<Item = &'s str> {
    let ids = (0..PORTS_MAX).map(|index| PortId(index as u8));
    ids.filter(|id| in_force.restarts(candidate, *id))
        .filter_map(|id| in_force.port(id).or(candidate.port(id)).map(|port| port.name.as_str()))
}

/// Says which ports end or restart.
fn restarts(session: &mut Session<'_, '_>, in_force: &Settings, candidate: &Settings) {
    let mut names = String::<{ PORTS_MAX * 20 }>::new();
    // Names have 15 bytes at most.
    restarting(in_force, candidate).for_each(|name| _ = write!(names, " {name}"));
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
