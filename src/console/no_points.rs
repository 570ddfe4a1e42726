//! What stands for the commands of data points in a gateway that has none: without the feature `points`.

use core::fmt;

use super::command::PointCommand;
use super::job::{Came, Job, Wait};
use super::output::Written;
use super::session::{Begun, Session};
use super::show::Source;
use crate::language::{Problem, Words};

/// There is none.
pub(super) enum PointJob {}

impl PointJob {
    pub(super) fn step(&mut self, _: &mut Session<'_, '_>, _: Came) -> Wait {
        match *self {}
    }
}

impl Session<'_, '_> {
    /// Says that there are none.
    pub(super) fn point(&mut self, _: PointCommand, words: &Words<'_>, _: &mut Job<'_>) -> Begun {
        Err(words.take().error(Problem::NoPoints))
    }

    /// `watch points`
    pub(super) fn watch_points(&mut self, _: &mut Job<'_>) -> Wait {
        self.fail(&Problem::NoPoints)
    }
}

/// `show points`
pub(super) fn row(_: &Source<'_, '_>, _: usize, _: &mut dyn fmt::Write) -> Written {
    None
}

/// `show devices`
pub(super) fn device(_: &Source<'_, '_>, _: usize, _: &mut dyn fmt::Write) -> Written {
    None
}
