//! What the web interface uses of the console: the rows of its tables, the roles of its commands, its direct requests.

use core::fmt::{self, Display};

use embassy_time::{Duration, Instant};

pub(crate) use super::alone::{NotBegun, Running};
pub(crate) use super::ask::Ask;
use super::ask::{Question, parse};
use super::candidate;
use super::command::commands;
use super::explain::Explained;
pub(crate) use super::log_in::Denied;
pub(crate) use super::output::Written;
pub(crate) use super::show::Show;
use super::show::write;
use super::table::Source;
use super::values::{Numbers, Values};
use crate::gateway::Gateway;
use crate::gateway::direct_request::{DirectRequestError, Turn};
use crate::hal::System;
use crate::language::{LineError, Words, Wrong};
use crate::modbus::Exception;
use crate::modbus::pdu::EXCEPTION_BIT;
use crate::scanner::{Pdu, RowId, Scale};
use crate::settings::{PointAt, Role, Settings};

/// Writes the row at `place` of a table: at place 0 the heading. Cells are separated by tabs.
pub(crate) fn row(
    gateway: &Gateway<'_>,
    system: &dyn System,
    what: Show,
    place: usize,
    out: &mut dyn fmt::Write,
) -> Written {
    let now = Instant::now();
    gateway.settings(|settings| write(&Source { gateway, settings, now }, system, what, place, out))
}

/// The least role that may run the command `name`.
pub(crate) fn role(name: &str) -> Role {
    commands().find(|known| known.name == name).map_or(Role::Engineer, |known| known.role)
}

/// What the rules do with a request, by the words of `explain` in `line`.
pub(crate) fn explain(settings: &Settings, line: &str) -> Result<Explained, LineError> {
    let words = Words::new(line);
    words.take();
    Explained::parse(settings, &words).map_err(|Wrong| words.wrong())
}

/// Whether a commit may wait for its confirmation for `time`.
pub(crate) fn may_wait(time: Duration) -> bool {
    candidate::CONFIRMED_RANGE.contains(&time)
}

/// Why a unit was not asked, or did not respond.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NotAsked {
    #[error(transparent)]
    Line(LineError),
    #[error(transparent)]
    Request(#[from] DirectRequestError),
}

/// A direct request, and then the response to it.
pub(crate) struct Asked<'t, 'g> {
    question: Question,
    /// Until it is answered.
    turn: Option<Turn<'t, 'g>>,
    pdu: Pdu,
    pub(crate) took: Duration,
}

impl<'t, 'g> Asked<'t, 'g> {
    /// Takes the turn for a request, by the words of `ping`, `read` or `write` in `line`.
    pub(crate) fn new(gateway: &'t Gateway<'g>, ask: Ask, line: &str) -> Result<Self, NotAsked> {
        let mut pdu = Pdu::new();
        let words = Words::new(line);
        words.take();
        let parsed = gateway.settings(|settings| parse(settings, ask, &words, &mut pdu));
        let (question, port) = parsed.map_err(|Wrong| NotAsked::Line(words.wrong()))?;
        Ok(Self { question, turn: Some(gateway.turn(port)?), pdu, took: Duration::from_ticks(0) })
    }

    /// Asks the unit.
    pub(crate) async fn ask(&mut self) -> Result<(), DirectRequestError> {
        let Some(turn) = self.turn.take() else { return Ok(()) };
        self.took = turn.ask(self.question.unit, &mut self.pdu).await?;
        let values = self.pdu.get_mut(2..).unwrap_or_default();
        self.question.value.form().turn(self.question.order, values);
        Ok(())
    }

    pub(crate) fn unit(&self) -> u8 {
        self.question.unit
    }

    /// The exception, if the response is one.
    pub(crate) fn exception(&self) -> Option<Exception> {
        match *self.pdu {
            [function, code] if function & EXCEPTION_BIT != 0 => Some(Exception(code)),
            _ => None,
        }
    }

    /// The values that were read, and the first one's address.
    pub(crate) fn values(&self) -> Option<(u16, Numbers<'_>)> {
        let Question { ask, first, count, value, .. } = self.question;
        let cells = self.pdu.get(2..).unwrap_or_default();
        let (scale, range) = (Scale::NONE, 0..count.into());
        (ask == Ask::Read).then_some((first, Numbers(Values { value, scale, cells, range })))
    }
}

/// A data point.
pub(crate) struct PointRow<'p> {
    pub(crate) name: &'p str,
    /// Its device, or `local`.
    pub(crate) device: &'p str,
    pub(crate) table: &'p dyn Display,
    pub(crate) address: u16,
    pub(crate) status: &'p dyn Display,
    /// Since the values were read.
    pub(crate) age: Option<Duration>,
    pub(crate) label: &'p dyn Display,
    pub(crate) values: Numbers<'p>,
}

/// Calls `write` with point `nth`; `None` after the last one.
pub(crate) fn point<R>(
    gateway: &Gateway<'_>,
    nth: usize,
    write: impl FnOnce(PointRow<'_>) -> R,
) -> Option<R> {
    let (scanner, id) = (gateway.scanner()?, RowId(u8::try_from(nth).ok()?));
    let now = Instant::now();
    gateway.settings(|settings| {
        let point = settings.points.get(nth)?;
        let device = match point.at {
            PointAt::Device { device, .. } => settings.device_name(device),
            PointAt::Local { .. } => "local",
        };
        Some(scanner.with(|scanner| {
            write(PointRow {
                name: &point.name,
                device,
                table: &point.kind,
                address: point.first,
                status: &scanner.status(id, now),
                age: scanner.age(id, now),
                label: &point.label,
                values: Numbers(Values {
                    value: point.value,
                    scale: point.scale,
                    cells: scanner.input(id),
                    range: 0..point.count.into(),
                }),
            })
        }))
    })
}
