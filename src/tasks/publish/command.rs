//! Points written by messages.

use embassy_time::{Duration, Instant};

use super::answer::{Answer, Command, Outcome};
use super::session::Session;
use super::source::Source;
use crate::console::{Refusal, settled, write_point};
use crate::gateway::audit::{Actor, Topic};
use crate::mqtt::Reply;
use crate::scanner::Status;
use crate::settings::PointName;

/// How long an answer waits for the write.
const PATIENCE: Duration = Duration::from_secs(5);

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
        if !session.takes_command() {
            log_warn!("publisher {}: more commands than are carried out at a time", self.publisher.name);
            self.state.report(|report| report.lost = report.lost.wrapping_add(1));
            return;
        }
        let refused = |why| Err(Refusal::try_from(why).unwrap_or_default());
        let begun = match (core::str::from_utf8(payload), &reply) {
            (_, None) => refused("the response topic or the correlation data is too long"),
            (Err(_), _) => refused("expected text (UTF-8)"),
            (Ok(text), _) => write_point(self.gateway, &point, text).inspect(|_| {
                let own = &self.publisher.name;
                let what = format_args!("publisher {own}: write {point} {text}");
                self.gateway.audit(Topic::Command, Actor::Gateway, what);
            }),
        };
        let reply = reply.unwrap_or_default();
        // There is room, see above.
        match begun {
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
