//! The commands of a candidate: begin, commit, take back.

use core::fmt::Display;
use core::ops::RangeInclusive;

use embassy_time::Duration;
use heapless::String;

use super::diff::Diff;
use super::job::Job;
use super::run::{Run, command};
use super::session::Session;
use super::wait::{Wait, WaitEvent};
use crate::gateway::Candidate;
use crate::gateway::audit::Way;
use crate::gateway::commit::Uncommitted;
use crate::hal::Store;
use crate::language::{Offer, Verbs, Words, Wrong, small, time};
use crate::settings::Role::{Engineer, Viewer};
use crate::settings::Time;

/// How long a commit waits for its confirmation by default.
const CONFIRMED: Duration = Duration::from_secs(5 * 60);
/// How long it may.
pub(super) const CONFIRMED_RANGE: RangeInclusive<Duration> =
    Duration::from_secs(10)..=Duration::from_secs(24 * 3_600);

/// Longest description of a version by a store.
const VERSION_BYTES_MAX: usize = 128;

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
        command(
            Engineer,
            "rollback [N]\ttakes back a commit, or brings a version back
rollback\ttakes back what waits for its confirmation
rollback N\tmakes a saved version the candidate, see versions;
\tthen diff, commit",
            |_, words, _| {
                if words.peek().is_end() {
                    return Ok(Wait::RollBack);
                }
                let nth = small(words.take(), "a version, see `versions`", 0..=u8::MAX)?;
                words.end()?;
                Ok(Wait::BringBack { nth: usize::from(nth) })
            },
        )
        .audited(),
    ),
    (
        "versions",
        command(
            Engineer,
            "versions\twhat was saved last, when and by whom
  LINES: how many came and went with it. rollback N: makes it the candidate.",
            |_, words, job| {
                words.end()?;
                *job = Job::Versions { next: 1 };
                Ok(Wait::Version { nth: 0 })
            },
        ),
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
        let who = (self.actor(), Way { port: self.port, by_name: false });
        match (candidate.commit(self.gateway, store, confirmed, who).await, confirmed) {
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

    /// `rollback N`
    pub(super) async fn bring_back(&mut self, store: &mut impl Store, nth: usize) {
        let Some(candidate) = self.gateway.candidate() else {
            self.fail(&Uncommitted::Nothing);
            return;
        };
        match candidate.bring_back(self.gateway, store, nth).await {
            Ok(()) => {
                self.out.line(format_args!("version {nth} is the candidate: see `diff`, then `commit`"))
            }
            Err(error) => _ = self.fail(&error),
        }
    }

    /// Writes the `nth` row of `versions`.
    pub(super) fn version(&mut self, store: &mut impl Store, nth: usize) -> WaitEvent {
        let mut known = String::<VERSION_BYTES_MAX>::new();
        // Fits, and what does not is cut.
        if store.write_version(nth, &mut known).is_none() {
            if nth == 0 {
                self.out.line(format_args!("nothing was saved so far"));
            }
            return WaitEvent::NoVersion;
        }
        let mut row = |number: &dyn Display, known: &str| {
            let mut cells = known.splitn(3, '\t');
            let [when, lines, who] = [(); 3].map(|()| cells.next().unwrap_or_default());
            self.out.line(format_args!("{number:>2} {when:20} {lines:9} {who}"));
        };
        if nth == 0 {
            row(&"NO", "TIME\tLINES\tWHO");
        }
        row(&nth, &known);
        WaitEvent::Nothing
    }
}
