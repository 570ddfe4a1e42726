//! `scan`: finds the units on a serial line, with their speed and format.
//!
//! The port is restarted with each speed and format in turn, and sends a harmless request to every unit not found yet. Any response
//! without a faulty character counts, exceptions included. Other requests for the port are refused meanwhile. However the scan ends,
//! the port returns to its own settings.

use core::fmt;

use embassy_time::{Duration, Instant};

use self::identity::Identity;
use self::plan::{Plan, SLOW};
use super::layout::{self, Layout};
use super::output::{NO_ROW, Written};
use super::probe::{About, Told, harmless, to_first_char};
use super::session::Session;
use super::wait::{Begun, Wait, WaitEvent};
use crate::gateway::direct_request::Turn;
use crate::hal::OpenErrorKind;
use crate::language::Words;
use crate::modbus::Exception;
use crate::modbus::pdu::EXCEPTION_BIT;
use crate::modbus::pdu::function::{ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, REPORT_SERVER_ID};
use crate::settings::{Destination, LineSettings, PortId, PortKind, Settings, Side, Time};
use crate::stats::Event;

mod identity;
mod offer;
mod plan;

/// Line errors: other formats, or noise.
const STRANGE: [Event; 5] = [Event::Parity, Event::Framing, Event::Noise, Event::BadCheck, Event::Short];
/// Valid frames that do not match the last request, but perhaps an earlier one.
const LATE: [Event; 4] = [Event::WrongUnit, Event::Misfit, Event::Late, Event::Unsolicited];
/// In place of a speed and format: the unit may be slow and is asked again.
const SLOW_UNIT: u8 = u8::MAX;
/// Errors caused by characters of another format.
const FLAWS: [Event; 2] = [Event::Parity, Event::Framing];
/// Read Device Identification, basic objects, from the first one.
const IDENTIFY: [u8; 4] = [ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, 1, 0];

/// A running scan.
pub(super) struct Scan {
    plan: Plan,
    /// By unit id: the number (from 1) of the speed and format at which it responded; 0: none yet.
    at: [u8; 256],
    begun: Instant,
    told: Told,
    stage: Stage,
    /// The number of the current speed and format, from 1.
    nth: usize,
    /// The next unit.
    unit: usize,
    /// Counter values before this speed and format, and before this request.
    strange: u32,
    flaws: u32,
    late: u32,
    /// Possibly slow units are asked again.
    again: bool,
}

/// What a scan does next.
#[derive(Debug, Clone, Copy)]
enum Stage {
    /// Tries the next speed and format.
    Line,
    /// Waits for the line to open.
    Opening,
    /// Asks the next unit.
    Unit,
    /// Waits for late responses after the last unit.
    Listening,
    /// Waits for a response to the harmless request, or to this identification request.
    Asked,
    Identified(&'static [u8]),
    /// Shows the results, from this row on.
    Found(usize),
    /// Waits for a key that accepts the proposed lines.
    Offered,
    /// Applies the proposed lines, from this row on.
    Taken(usize),
}

impl Session<'_, '_> {
    /// Starts a scan.
    pub(super) fn scan(&mut self, words: &Words<'_>) -> Begun<Scan> {
        let plan = self.gateway.settings(|settings| Plan::parse(settings, words))?;
        if let Err(error) = self.take_turn(plan.port) {
            return Ok((None, self.fail(&error)));
        }
        let about = About(plan.time_from(0));
        self.out.line(format_args!(
            "about {about}; a key stops it. Requests through this port get 0A meanwhile."
        ));
        let scan = Scan {
            plan,
            at: [0; 256],
            begun: Instant::now(),
            told: Told::new(),
            stage: Stage::Line,
            nth: 0,
            unit: 0,
            strange: 0,
            flaws: 0,
            late: 0,
            again: false,
        };
        Ok((Some(scan), Wait::Sent))
    }

    /// The sum of these counters of `port`.
    fn heard(&self, port: PortId, events: &[Event]) -> u32 {
        let state = self.gateway.ports().get(port.index());
        state.map_or(0, |state| events.iter().fold(0, |sum, event| sum.wrapping_add(state.stats.get(*event))))
    }
}

impl Scan {
    /// The current speed and format.
    fn tried(&self) -> LineSettings {
        self.nth.checked_sub(1).and_then(|nth| self.plan.line(nth)).unwrap_or(self.plan.own)
    }

    /// Runs the next step after `event`.
    pub(super) fn step(&mut self, session: &mut Session<'_, '_>, event: WaitEvent) -> Wait {
        match (self.stage, event) {
            (Stage::Found(place), _) => return self.show(session, place),
            (Stage::Offered, WaitEvent::Key(b'y' | b'Y')) => {
                session.out.line(format_args!("yes"));
                return self.take_over(session, 1);
            }
            (Stage::Offered, _) => {
                session.out.end();
                return Wait::End;
            }
            (Stage::Taken(place), _) => return self.take_over(session, place),
            (_, WaitEvent::Typed(_)) => self.end(session),
            (Stage::Line, _) => return self.next_line(session),
            (Stage::Opening, WaitEvent::Opened(Err(error))) => {
                session.out.line(format_args!("{:12} {error}", self.tried().speed()));
                // Another speed or format may be supported, but a missing device stays missing.
                match error.kind {
                    OpenErrorKind::Unsupported => self.stage = Stage::Line,
                    _ => self.end(session),
                }
            }
            (Stage::Opening, _) => {
                self.strange = session.heard(self.plan.port, &STRANGE);
                self.late = session.heard(self.plan.port, &LATE);
                self.unit = self.plan.units.first.into();
                self.stage = Stage::Unit;
            }
            (Stage::Unit, _) => return self.next_unit(session),
            (Stage::Listening, _) => return self.end_of_units(session),
            (Stage::Asked, WaitEvent::Response(asked)) => return self.asked(session, asked.is_ok()),
            (Stage::Identified(question), WaitEvent::Response(asked)) => {
                if asked.is_ok() && session.pdu.first() == question.first() {
                    session.out.put(format_args!("{}", Identity(&session.pdu)));
                } else if question.len() > 1 {
                    return self.identify(session, &[REPORT_SERVER_ID]);
                }
                session.out.end();
                self.stage = Stage::Unit;
            }
            (Stage::Asked | Stage::Identified(_), _) => self.end(session),
        }
        Wait::Sent
    }

    /// Restores the port's own settings.
    fn end(&mut self, session: &mut Session<'_, '_>) {
        session.turn = None;
        self.stage = Stage::Found(0);
    }

    /// Tries the next speed and format.
    fn next_line(&mut self, session: &mut Session<'_, '_>) -> Wait {
        let Some(line) = self.plan.line(self.nth) else {
            self.end(session);
            return Wait::Sent;
        };
        self.nth += 1;
        if self.plan.is_again(self.nth - 1) {
            return Wait::Sent;
        }
        let left = self.plan.time_from(self.nth - 1);
        let here = About(left - self.plan.time_from(self.nth));
        session.out.line(format_args!("{:12} about {here}; in all {} left", line.speed(), About(left)));
        self.stage = Stage::Opening;
        Wait::Open { line, timeout: self.plan.patience(&line), alone: true }
    }

    /// Asks the next unit not found yet.
    fn next_unit(&mut self, session: &mut Session<'_, '_>) -> Wait {
        let last = usize::from(self.plan.units.last);
        let due = if self.again { SLOW_UNIT } else { 0 };
        while self.unit <= last && self.at.get(self.unit).is_some_and(|at| *at != due) {
            self.unit += 1;
        }
        if self.unit > last {
            self.stage = Stage::Listening;
            let rest = if self.again { Duration::from_ticks(0) } else { self.plan.rest(&self.tried()) };
            return Wait::Rest(rest);
        }
        if self.told.is_due() {
            session.out.line(format_args!("{:12} unit {}", self.tried().speed(), self.unit));
        }
        self.flaws = session.heard(self.plan.port, &FLAWS);
        self.stage = Stage::Asked;
        session.ask_unit(self.unit as u8, harmless(self.plan.function), true)
    }

    /// Ends a speed and format. After late responses, some units are asked again.
    fn end_of_units(&mut self, session: &mut Session<'_, '_>) -> Wait {
        self.note_late(session);
        let speed = self.tried().speed();
        let slow = self.at.iter().filter(|at| **at == SLOW_UNIT).count();
        if slow > 0 && !self.again {
            let timeout = Time(SLOW);
            session.out.line(format_args!("{speed:12} slower units: timeout {timeout}, {slow} asked again"));
            self.again = true;
            self.stage = Stage::Opening;
            return Wait::Open { line: self.tried(), timeout: SLOW, alone: true };
        }
        self.again = false;
        self.at.iter_mut().filter(|at| **at == SLOW_UNIT).for_each(|at| *at = 0);
        let strange = session.heard(self.plan.port, &STRANGE).wrapping_sub(self.strange);
        if strange > 0 {
            let what = "things heard that cannot be read: another speed or format, or noise";
            session.out.line(format_args!("{speed:12} {strange} {what}"));
        }
        self.stage = Stage::Line;
        Wait::Sent
    }

    /// A late response comes from one of the units asked last.
    fn note_late(&mut self, session: &Session<'_, '_>) {
        let late = session.heard(self.plan.port, &LATE);
        if late == self.late || self.again || self.plan.patience(&self.tried()) >= SLOW {
            return;
        }
        self.late = late;
        let count = self.plan.slow_units(&self.tried()).min(self.unit);
        let asked = self.at.iter_mut().take(self.unit).skip(self.plan.units.first.into());
        asked.rev().take(count).filter(|at| **at == 0).for_each(|at| *at = SLOW_UNIT);
    }

    /// Handles the outcome of a request.
    fn asked(&mut self, session: &mut Session<'_, '_>, answered: bool) -> Wait {
        let unit = self.unit;
        self.unit += 1;
        self.stage = Stage::Unit;
        self.note_late(session);
        match session.turn.as_ref().and_then(Turn::outcome) {
            // A faulty character means another format, even if the CRC is right.
            Some(Ok(took)) if answered && session.heard(self.plan.port, &FLAWS) == self.flaws => {
                self.at.iter_mut().skip(unit).take(1).for_each(|at| *at = self.nth as u8);
                let took = to_first_char(took, self.plan.framing, &self.tried(), session.pdu.len());
                let (speed, took, how) = (self.tried().speed(), Time(took), Answered(&session.pdu));
                session.out.put(format_args!("unit {unit:>3} {speed:12} {took} {how}"));
                self.identify(session, &IDENTIFY)
            }
            Some(_) => Wait::Sent,
            None => {
                session.fail(&"the line is not open any more: see show ports");
                self.end(session);
                Wait::Sent
            }
        }
    }

    /// Requests the identification of the unit found.
    fn identify(&mut self, session: &mut Session<'_, '_>, question: &'static [u8]) -> Wait {
        self.stage = Stage::Identified(question);
        session.ask_unit(session.unit, question, false)
    }

    fn show(&mut self, session: &mut Session<'_, '_>, mut place: usize) -> Wait {
        let gateway = session.gateway;
        let lines = Layout::fixed(&[]);
        let wait = layout::row(&mut session.out, &lines, &mut place, &mut |place, out| {
            gateway.settings(|settings| self.write(&self.plan, settings, place, out))
        });
        self.stage = Stage::Found(place);
        let is_offered = matches!(wait, Wait::End) && session.line_number.is_none();
        if is_offered && gateway.settings(|settings| self.is_clear(settings)) {
            session.out.put(format_args!("y takes this over; any other key leaves it: "));
            self.stage = Stage::Offered;
            return Wait::Key;
        }
        wait
    }

    /// Writes the summary and the proposed lines.
    fn write(&self, plan: &Plan, settings: &Settings, place: usize, out: &mut dyn fmt::Write) -> Written {
        let found = || self.at.iter().enumerate().filter(|(_, at)| **at > 0).map(|(unit, _)| unit);
        let name = settings.name(plan.port);
        let Some(nth) = place.checked_sub(1) else {
            let (units, took) = (found().count(), self.begun.elapsed().as_secs());
            return Some(write!(out, "{units} units found in {took}s"));
        };
        if let Some(line) = plan.line(nth) {
            let at = nth as u8 + 1;
            let units = UnitList { search: self, at };
            let is_there = self.at.contains(&at);
            return if is_there {
                Some(write!(out, "edit port {name} {:12} # units {units}", line.speed()))
            } else {
                NO_ROW
            };
        }
        let is_routed = settings.routes.iter().any(|route| route.destination == Destination::Port(plan.port));
        let (first, last) = (found().next()?, found().next_back()?);
        if is_routed || nth > plan.lines_count() {
            return None;
        }
        let source = source(settings).unwrap_or("SOURCE");
        Some(write!(out, "route {source} {first}-{last} * * {name}"))
    }
}

/// The port for the proposed rules: its clients get access to the units found.
fn source(settings: &Settings) -> Option<&str> {
    let is_server = |kind: &PortKind| kind.side() == Side::Server && !kind.asks_by_itself();
    settings.ports.iter().flatten().find(|port| is_server(&port.kind)).map(|port| port.name.as_str())
}

/// The function, and its exception if there was one.
struct Answered<'p>(&'p [u8]);

impl fmt::Display for Answered<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self.0 {
            [function, code] if function & EXCEPTION_BIT != 0 => {
                write!(f, "function {}: {}", function & !EXCEPTION_BIT, Exception(code))
            }
            [function, ..] => write!(f, "function {function}"),
            [] => Ok(()),
        }
    }
}

/// The units found at one speed and format.
struct UnitList<'s> {
    search: &'s Scan,
    at: u8,
}

impl fmt::Display for UnitList<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let units = self.search.at.iter().enumerate().filter(|(_, at)| **at == self.at);
        for (nth, (unit, _)) in units.enumerate() {
            write!(f, "{}{unit}", if nth > 0 { "," } else { "" })?;
        }
        Ok(())
    }
}
