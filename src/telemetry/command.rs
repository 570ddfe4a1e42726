//! Points written by messages.

use core::fmt;

use embassy_time::{Duration, Instant};

use super::answer::{Answer, Command, Outcome};
use super::session::Session;
use super::source::Source;
use crate::console::{Refusal, settled, write_point};
use crate::gateway::audit::{Actor, Topic};
use crate::mqtt::Reply;
use crate::scanner::{RowId, Status};
use crate::settings::PointName;

/// How long an answer waits for the write.
const PATIENCE: Duration = Duration::from_secs(5);

pub(super) fn refusal(why: &str) -> Refusal {
    Refusal::try_from(why).unwrap_or_default()
}

impl Source<'_, '_> {
    /// The point that `topic` writes.
    fn commanded<'t>(&self, topic: &'t str) -> Option<&'t str> {
        let rest = topic.strip_prefix(self.publisher.topic.as_str())?.strip_prefix("/points/")?;
        rest.strip_suffix("/set").filter(|name| !name.contains('/'))
    }

    /// Begins to write what a message asks for. A retained one is of before, and does nothing.
    pub(super) fn message(
        &self,
        session: &mut Session,
        topic: &str,
        payload: &[u8],
        retained: bool,
        reply: Option<Reply>,
    ) {
        let name = self.commanded(topic).and_then(|name| PointName::try_from(name).ok());
        let Some(point) = name.filter(|_| self.publisher.commands && !retained) else { return };
        let has_reply = reply.is_some();
        self.command(session, point, reply.unwrap_or_default(), |point| {
            match core::str::from_utf8(payload) {
                _ if !has_reply => Err(refusal("the response topic or the correlation data is too long")),
                Err(_) => Err(refusal("expected text (UTF-8)")),
                Ok(text) => self.write(point, None, text),
            }
        });
    }

    /// Writes `text` to a point, or to its value `nth`.
    pub(super) fn write(&self, point: &str, nth: Option<u16>, text: &str) -> Result<RowId, Refusal> {
        let row = write_point(self.gateway, point, nth, text)?;
        let at = fmt::from_fn(|f| nth.map_or(Ok(()), |nth| write!(f, "at {nth} ")));
        let what = format_args!("publisher {}: write {point} {at}{text}", self.publisher.name);
        self.gateway.audit(Topic::Command, Actor::Gateway, what);
        Ok(row)
    }

    /// Begins a command as `begin` does, unless there are too many.
    pub(super) fn command(
        &self,
        session: &mut Session,
        point: PointName,
        reply: Reply,
        begin: impl FnOnce(&str) -> Result<RowId, Refusal>,
    ) {
        if !session.takes_command() {
            log_warn!("publisher {}: more commands than are carried out at a time", self.publisher.name);
            self.state.report(|report| report.lost = report.lost.wrapping_add(1));
            return;
        }
        // There is room, see above.
        match begin(&point) {
            Ok(row) => {
                let until = Instant::now() + PATIENCE;
                let _ = session.commands.push(Command { point, row, until, reply });
            }
            Err(why) => {
                let _ = session.answers.push_back(Answer { point, outcome: Outcome::Refused(why), reply });
            }
        }
    }

    /// Makes answers of the commands that are done.
    pub(super) fn settle(&self, session: &mut Session) {
        let Some(scanner) = self.gateway.scanner() else { return };
        let mut at = 0;
        while let Some(command) = session.commands.get(at) {
            let Some(is_done) = settled(scanner, command.row, command.until) else {
                at += 1;
                continue;
            };
            let status = scanner.with(|scanner| scanner.status(command.row, Instant::now()));
            let outcome = match status.error().filter(|_| status.any(Status::LAST_WAS_WRITE)) {
                _ if !is_done => Outcome::Waits,
                Some(error) => Outcome::Failed(error.name()),
                None => Outcome::Written,
            };
            let Command { point, reply, .. } = session.commands.remove(at);
            let _ = session.answers.push_back(Answer { point, outcome, reply });
        }
    }
}
