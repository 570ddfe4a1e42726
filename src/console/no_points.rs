//! What stands for the commands of data points in a gateway that has none: without the feature `points`.

use core::fmt;

use embedded_io_async::{Read, Write};

use super::command::{PointCommand, Session};
use super::show::{Source, Written};
use crate::config::{Problem, Words};
use crate::hal::{Store, System};

impl<IO: Read + Write, S: Store, Y: System> Session<'_, '_, IO, S, Y> {
    /// Says that there are none.
    pub(super) async fn point(&mut self, _: PointCommand, words: &Words<'_>) -> Result<(), IO::Error> {
        words.take().error(Problem::NoPoints);
        self.fail(format_args!("{}", words.wrong())).await
    }

    /// `watch points`
    pub(super) async fn watch_points(&mut self) -> Result<(), IO::Error> {
        self.fail(format_args!("{}", Problem::NoPoints)).await
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
