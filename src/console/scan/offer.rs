//! Applies the lines that a scan proposes, as if they were typed.

use core::fmt;

use super::{Scan, Stage, source};
use crate::console::session::Session;
use crate::console::wait::Wait;
use crate::settings::{Destination, Settings};

impl Scan {
    /// Whether there are lines to apply, without a choice among them.
    pub(super) fn is_clear(&self, settings: &Settings) -> bool {
        let mut found = self.at.iter().copied().filter(|at| *at > 0);
        let Some(first) = found.next().filter(|first| found.all(|at| at == *first)) else { return false };
        let is_routed =
            settings.routes.iter().any(|route| route.destination == Destination::Port(self.plan.port));
        let line = self.plan.line(usize::from(first) - 1);
        let is_own = line.is_some_and(|line| self.plan.is_own(&line));
        !is_own || !is_routed && source(settings).is_some()
    }

    /// Applies the lines, from this row on.
    pub(super) fn take_over(&mut self, session: &mut Session<'_, '_>, mut place: usize) -> Wait {
        loop {
            let mut length = Length(0);
            let written =
                session.gateway.settings(|settings| self.write(&self.plan, settings, place, &mut length));
            // A rule needs a source.
            let is_rule = place > self.plan.lines_count();
            if written.is_none() || is_rule && session.gateway.settings(|settings| source(settings).is_none())
            {
                return Wait::End;
            }
            place += 1;
            if length.0 > 0 {
                self.stage = Stage::Taken(place);
                return session.change();
            }
        }
    }

    /// Writes the line being applied, if any.
    pub(in crate::console) fn line(&self, settings: &Settings, out: &mut dyn fmt::Write) {
        if let Stage::Taken(behind) = self.stage {
            let _ = self.write(&self.plan, settings, behind - 1, out);
        }
    }
}

/// The length of a text.
struct Length(usize);

impl fmt::Write for Length {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0 += text.len();
        Ok(())
    }
}
