//! Commands of several steps.

use super::ask::Question;
// As its module.
#[cfg(feature = "candidate")]
use super::diff::Diff;
use super::frames::Frames;
use super::help::{Help, TYPED_COLUMNS};
use super::points::PointJob;
use super::scan::Scan;
use super::session::Session;
use super::show::Table;
use super::tune::Tune;
use super::wait::{Wait, WaitEvent};

/// The running command.
// One per session.
#[allow(clippy::large_enum_variant)]
pub(super) enum Job<'g> {
    Idle,
    Help(Help),
    Show(Table),
    Frames(Frames<'g>),
    Ask(Question),
    Scan(Scan),
    Tune(Tune),
    Point(PointJob),
    // As its module.
    #[cfg(feature = "candidate")]
    Diff(Diff),
    /// The saved versions, of which this one is next.
    #[cfg(feature = "candidate")]
    Versions {
        next: usize,
    },
}

impl Job<'_> {
    /// Runs the next step after `event`.
    pub(super) fn step(&mut self, session: &mut Session<'_, '_>, event: WaitEvent) -> Wait {
        match self {
            Self::Idle => Wait::End,
            Self::Help(help) => match help.next() {
                Some((typed, does)) => {
                    session.out.line(format_args!("{typed:TYPED_COLUMNS$} {does}"));
                    Wait::Sent
                }
                None => Wait::End,
            },
            Self::Show(table) => table.row(session.gateway, session.system, &mut session.out),
            Self::Frames(frames) => frames.step(session, event),
            Self::Ask(question) => question.step(session, event),
            Self::Scan(scan) => scan.step(session, event),
            Self::Tune(tune) => tune.step(session, event),
            Self::Point(point) => point.step(session, event),
            #[cfg(feature = "candidate")]
            Self::Diff(diff) => diff.step(session),
            #[cfg(feature = "candidate")]
            Self::Versions { .. } if matches!(event, WaitEvent::NoVersion) => Wait::End,
            #[cfg(feature = "candidate")]
            Self::Versions { next } => {
                let nth = *next;
                *next += 1;
                Wait::Version { nth }
            }
        }
    }
}
