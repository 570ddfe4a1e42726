//! The commands that take more than one step, and what they wait for in between.

use embassy_time::Duration;

use super::ask::Question;
use super::frames::Frames;
use super::help::Help;
use super::points::PointJob;
use super::scan::Scan;
use super::session::Session;
use super::show::Table;
use super::tune::Tune;
use crate::gateway::direct_request::NotAsked;
use crate::hal::OpenError;
use crate::settings::LineSettings;

/// What is waited for behind a step, when what it has written is sent.
#[derive(Debug, Clone, Copy)]
pub(super) enum Wait {
    /// Nothing more.
    Sent,
    /// A key, or text.
    Key,
    /// So long, or that something is typed.
    Pause(Duration),
    /// So long, whatever is typed.
    // Only points want that.
    #[cfg_attr(not(feature = "points"), expect(dead_code))]
    Rest(Duration),
    /// The answer to the session's question, or that something is typed if that ends it.
    Answer {
        typed_ends: bool,
    },
    /// That the port of the session's turn is open with other settings.
    Open {
        line: LineSettings,
        timeout: Duration,
        alone: bool,
    },
    /// That the line has changed the settings, that they are saved, or taken over.
    Change,
    Save {
        /// What somebody else has written there meanwhile is written over.
        whatever: bool,
    },
    Load,
    Reboot,
    /// The command is done.
    End,
    /// The session is done.
    Exit,
}

impl Wait {
    /// Whether it matters what is typed meanwhile.
    pub(super) fn listens(self) -> bool {
        matches!(self, Self::Key | Self::Pause(_) | Self::Answer { typed_ends: true })
    }
}

/// What came of waiting.
#[derive(Debug, Clone, Copy)]
pub(super) enum Came {
    /// The time is over, or there was nothing to wait for.
    Nothing,
    Key(u8),
    /// So many bytes; 0: the input has ended.
    Typed(usize),
    Answer(Result<Duration, NotAsked>),
    Opened(Result<(), OpenError>),
}

/// A command that runs.
// There is one in a session.
#[allow(clippy::large_enum_variant)]
pub(super) enum Job<'g> {
    /// None.
    Idle,
    Help(Help),
    Show(Table),
    Frames(Frames<'g>),
    Ask(Question),
    Scan(Scan),
    Tune(Tune),
    // Without points there is no such command.
    #[cfg_attr(not(feature = "points"), expect(dead_code))]
    Point(PointJob),
}

impl Job<'_> {
    /// Goes on behind what `came`.
    pub(super) fn step(&mut self, session: &mut Session<'_, '_>, came: Came) -> Wait {
        match self {
            Self::Idle => Wait::End,
            Self::Help(help) => match help.next() {
                Some((typed, does)) => {
                    session.out.line(format_args!("{typed:32} {does}"));
                    Wait::Sent
                }
                None => Wait::End,
            },
            Self::Show(table) => table.step(session),
            Self::Frames(frames) => frames.step(session, came),
            Self::Ask(question) => question.step(session, came),
            Self::Scan(scan) => scan.step(session, came),
            Self::Tune(tune) => tune.step(session, came),
            Self::Point(point) => point.step(session, came),
        }
    }
}
