//! The commands of a candidate: begin, commit, take back.

use core::ops::RangeInclusive;

use embassy_time::Duration;

use super::diff::Diff;
use super::job::Job;
use super::run::{Run, command};
use super::session::Session;
use super::wait::Wait;
use crate::gateway::Candidate;
use crate::gateway::commit::Uncommitted;
use crate::hal::Store;
use crate::language::{Offer, Verbs, Words, Wrong, time};
use crate::settings::Role::{Engineer, Viewer};
use crate::settings::{Settings, Time};

/// How long a commit waits for its confirmation, unless told.
const CONFIRMED: Duration = Duration::from_secs(5 * 60);
/// How long it may.
const CONFIRMED_RANGE: RangeInclusive<Duration> = Duration::from_secs(10)..=Duration::from_secs(24 * 3_600);

/// The commands.
pub(super) const COMMANDS: Verbs<Run> = &[
    (
        "candidate",
        command(
            Engineer,
            "candidate\tbegins settings that commit puts in force at once
  It has the settings in force. Until commit or discard, lines of settings at
  all consoles change the candidate. show candidate, diff: what it has.",
            |session, words, _| {
                words.end()?;
                Ok(session.of_candidate(|candidate, session| candidate.begin(session.gateway)))
            },
        ),
    ),
    (
        "diff",
        command(Viewer, "diff\thow the candidate differs, and what restarts", |session, words, job| {
            words.end()?;
            if let Some(Err(error)) = session.gateway.candidate().map(Candidate::settings) {
                return Ok(session.fail(&error));
            }
            *job = Job::Diff(Diff::default());
            Ok(Wait::Sent)
        }),
    ),
    (
        "commit",
        command(
            Engineer,
            "commit [confirmed [TIME]]\tputs the candidate in force, and saves it
commit check\tonly checks whether it could
commit confirmed [TIME]\tin force now; unless a further commit confirms
\tit within TIME (5m), or after a reset, the
\tsettings from before are back
commit\tputs it in force and saves it, or confirms",
            commit,
        )
        .audited()
        .then(&[Offer::Words(&["check", "confirmed"])], &[]),
    ),
    (
        "rollback",
        command(Engineer, "rollback\ttakes back what waits for its confirmation", |_, words, _| {
            words.end()?;
            Ok(Wait::RollBack)
        })
        .audited(),
    ),
    (
        "discard",
        command(Engineer, "discard\tdrops the candidate", |session, words, _| {
            words.end()?;
            Ok(session.of_candidate(|candidate, _| candidate.discard()))
        }),
    ),
];

/// `commit`, `commit check`, `commit confirmed`, `commit confirmed TIME`
fn commit(session: &mut Session<'_, '_>, words: &Words<'_>, _: &mut Job<'_>) -> Result<Wait, Wrong> {
    const KINDS: &[(&str, bool)] = &[("check", false), ("confirmed", true)];
    if words.peek().is_end() {
        return Ok(Wait::Commit { confirmed: None });
    }
    if !words.take().keyword(KINDS, "check, confirmed or the end of the line")? {
        words.end()?;
        return Ok(session.of_candidate(|candidate, session| {
            session.gateway.check(&*candidate.settings()?)?;
            session.out.line(format_args!("the board can have it"));
            Ok(())
        }));
    }
    let confirmed = if words.peek().is_end() { CONFIRMED } else { time(words.take(), &CONFIRMED_RANGE)? };
    words.end()?;
    Ok(Wait::Commit { confirmed: Some(confirmed) })
}

impl<'g> Session<'_, 'g> {
    /// Does something with the candidate.
    fn of_candidate(&mut self, run: impl FnOnce(&Candidate, &mut Self) -> Result<(), Uncommitted>) -> Wait {
        match self.gateway.candidate().ok_or(Uncommitted::Nothing).and_then(|candidate| run(candidate, self))
        {
            Ok(()) => Wait::End,
            Err(error) => self.fail(&error),
        }
    }

    /// `commit`, `commit confirmed`
    pub(super) async fn commit(&mut self, store: &mut impl Store, confirmed: Option<Duration>) {
        let Some(candidate) = self.gateway.candidate() else {
            self.fail(&Uncommitted::Nothing);
            return;
        };
        let ahead = |new: &Settings| self.audit_difference(new);
        match (candidate.commit(self.gateway, store, confirmed, &ahead).await, confirmed) {
            (Err(error), _) => _ = self.fail(&error),
            (Ok(()), None) => self.out.line(format_args!("in force and saved")),
            (Ok(()), Some(time)) => self.out.line(format_args!(
                "in force: commit within {} confirms it, or the settings from before come back",
                Time(time)
            )),
        }
    }

    /// `rollback`
    pub(super) async fn roll_back(&mut self) {
        let Some(candidate) = self.gateway.candidate() else {
            self.fail(&Uncommitted::NotWaiting);
            return;
        };
        match candidate.roll_back(self.gateway, self.actor()).await {
            Ok(()) => self.out.line(format_args!("the settings from before are back in force")),
            Err(error) => _ = self.fail(&error),
        }
    }
}
