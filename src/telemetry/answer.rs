//! Commands in progress, and the answers to them.

use core::fmt::{self, Write};

use embassy_time::Instant;

use crate::console::Refusal;
use crate::language::json::Quoted;
use crate::mqtt::Reply;
use crate::scanner::RowId;
use crate::settings::PointName;

/// A write in progress.
pub(super) struct Command {
    pub(super) point: PointName,
    pub(super) row: RowId,
    pub(super) until: Instant,
    pub(super) reply: Reply,
}

/// What became of a command.
pub(super) struct Answer {
    pub(super) point: PointName,
    pub(super) outcome: Outcome,
    pub(super) reply: Reply,
}

pub(super) enum Outcome {
    Written,
    /// It is not valid, or not allowed.
    Refused(Refusal),
    /// The device did not take it.
    Failed(&'static str),
    /// The device does not respond.
    Waits,
}

impl Answer {
    pub(super) fn write(&self, out: &mut dyn Write) -> fmt::Result {
        match &self.outcome {
            Outcome::Written => out.write_str("{\"result\":\"written\"}"),
            Outcome::Refused(why) => write!(out, "{{\"result\":\"refused\",\"error\":{}}}", Quoted(why)),
            Outcome::Failed(why) => write!(out, "{{\"result\":\"failed\",\"error\":\"{why}\"}}"),
            Outcome::Waits => {
                out.write_str("{\"result\":\"waits\",\"error\":\"the device does not respond: it is written once it does\"}")
            }
        }
    }
}
