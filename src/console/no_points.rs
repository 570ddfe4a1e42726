//! Stubs for the commands of data points, without the feature `points`.

use core::fmt;

use super::layout::Columns;
use super::output::Written;
use super::point_command::PointCommand;
use super::session::Session;
use super::table::Source;
use super::wait::{Begun, Wait, WaitEvent};
use crate::language::{Problem, Words};

pub(super) enum PointJob {}

impl PointJob {
    pub(super) fn step(&mut self, _: &mut Session<'_, '_>, _: WaitEvent) -> Wait {
        match *self {}
    }
}

impl Session<'_, '_> {
    /// Reports that there are no points.
    pub(super) fn point(&mut self, _: PointCommand, words: &Words<'_>) -> Begun<PointJob> {
        Err(words.take().error(Problem::NoPoints))
    }

    /// `watch points`
    pub(super) fn watch_points(&mut self) -> Begun<PointJob> {
        Ok((None, self.fail(&Problem::NoPoints)))
    }
}

pub(super) const COLUMNS: Columns = &[];
pub(super) const DEVICE_COLUMNS: Columns = &[];

/// `show points`
pub(super) fn row(_: &Source<'_, '_>, _: usize, _: &mut dyn fmt::Write) -> Written {
    None
}

/// `show devices`
pub(super) fn device(_: &Source<'_, '_>, _: usize, _: &mut dyn fmt::Write) -> Written {
    None
}
