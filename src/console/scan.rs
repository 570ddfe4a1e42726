//! `scan`: which units are on a serial line, and at which speed and format.
//!
//! The port is started again with each speed and format in turn, and asks every unit that has not been found yet for something
//! harmless; any answer counts, exceptions included, if it came without a faulty character. All others who ask by the port are
//! refused meanwhile. Whatever ends the scan, the port has its own settings again.

use core::fmt;

use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};

use self::identity::Identity;
use self::plan::Plan;
use super::command::Session;
use super::probe::{About, Watch, request, to_first_char};
use super::show::{NO_ROW, Written};
use crate::asking::Turn;
use crate::config::{LineSettings, PortId, PortKind, Settings, Side, Time, Words, Wrong};
use crate::hal::{OpenErrorKind, Store, System};
use crate::modbus::Exception;
use crate::modbus::pdu::EXCEPTION_BIT;
use crate::modbus::pdu::function::{ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, REPORT_SERVER_ID};
use crate::route::Destination;
use crate::scanner::Pdu;
use crate::stats::Event;

mod identity;
mod plan;

/// What is heard and cannot be read.
const STRANGE: [Event; 6] =
    [Event::Parity, Event::Framing, Event::Noise, Event::BadCheck, Event::Short, Event::WrongUnit];
/// Read device identification, the basic objects, from the first on.
const IDENTIFY: [u8; 4] = [ENCAPSULATED_INTERFACE, MEI_DEVICE_IDENTIFICATION, 1, 0];

/// What has been found so far.
struct Search {
    /// By unit id: the number of the speed and format at which it answered, from 1; 0: not yet.
    at: [u8; 256],
    begun: Instant,
    watch: Watch,
    /// The last one.
    answer: Pdu,
}

impl Search {
    /// Writes what has been found in all, and the lines to type for it.
    fn write(&self, plan: &Plan, settings: &Settings, place: usize, out: &mut dyn fmt::Write) -> Written {
        let found = || self.at.iter().enumerate().filter(|(_, at)| **at > 0).map(|(unit, _)| unit);
        let name = settings.name(plan.port);
        let Some(nth) = place.checked_sub(1) else {
            let (units, took) = (found().count(), self.begun.elapsed().as_secs());
            return Some(write!(out, "{units} units found in {took}s"));
        };
        if let Some(line) = plan.lines().nth(nth) {
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
        if is_routed || nth > plan.lines().count() {
            return None;
        }
        let is_server = |kind: &PortKind| kind.side() == Side::Server && !kind.asks_by_itself();
        let server = settings.ports.iter().flatten().find(|port| is_server(&port.kind));
        let source = server.map_or("SOURCE", |port| port.name.as_str());
        Some(write!(out, "route {source} {first}-{last} * * {name}"))
    }
}

impl<IO: Read + Write, S: Store, Y: System> Session<'_, '_, IO, S, Y> {
    /// Looks for units as the words say.
    pub(super) async fn scan(&mut self, words: &Words<'_>) -> Result<(), IO::Error> {
        let plan = match self.gateway.settings(|settings| Plan::parse(settings, words)) {
            Ok(plan) => plan,
            Err(Wrong) => return self.fail(format_args!("{}", words.wrong())).await,
        };
        let gateway = self.gateway;
        let turn = match gateway.turn(plan.port) {
            Ok(turn) => turn,
            Err(error) => return self.fail(format_args!("{error}")).await,
        };
        let about = About(plan.time_from(0));
        self.out
            .line(format_args!(
                "about {about}; a key stops it. Others who ask by this port get 0A meanwhile."
            ))
            .await?;
        let mut search =
            Search { at: [0; 256], begun: Instant::now(), watch: Watch::new(), answer: Pdu::new() };
        for (nth, line) in plan.lines().enumerate() {
            self.out
                .line(format_args!("{:12} about {} left", line.speed(), About(plan.time_from(nth))))
                .await?;
            self.out.flush().await?;
            if !self.scan_at(&plan, &turn, (nth, line), &mut search).await? {
                break;
            }
        }
        drop(turn);
        self.rows(|place, out| gateway.settings(|settings| search.write(&plan, settings, place, out))).await
    }

    /// Asks every unit that is still missing at one speed and format; says whether to go on.
    async fn scan_at(
        &mut self,
        plan: &Plan,
        turn: &Turn<'_, '_>,
        (nth, line): (usize, LineSettings),
        search: &mut Search,
    ) -> Result<bool, IO::Error> {
        if let Err(error) = turn.try_on(line, plan.patience(&line), true).await {
            self.out.line(format_args!("{:12} {error}", line.speed())).await?;
            // Another speed or format may be supported; another device there is not.
            return Ok(error.kind == OpenErrorKind::Unsupported);
        }
        let strange = self.heard(plan.port, &STRANGE);
        for unit in plan.units.first..=plan.units.last {
            if search.at.get(usize::from(unit)) != Some(&0) {
                continue;
            }
            if search.watch.is_due() {
                self.out.line(format_args!("{:12} unit {unit}", line.speed())).await?;
                self.out.flush().await?;
            }
            let flaws = self.heard(plan.port, &[Event::Parity, Event::Framing]);
            let request = request(plan.function);
            let ask = turn.ask(unit, &request, &mut search.answer);
            let Some(asked) = self.unless_typed(&mut search.watch, ask).await? else { return Ok(false) };
            match (asked, turn.outcome()) {
                (Ok(_), Some(Ok(took))) => {
                    // With a faulty character it was sent in another format, whatever its CRC says.
                    if self.heard(plan.port, &[Event::Parity, Event::Framing]) == flaws {
                        search.at.iter_mut().skip(unit.into()).take(1).for_each(|at| *at = nth as u8 + 1);
                        let took = to_first_char(took, plan.framing, &line, search.answer.len());
                        self.tell_unit(turn, unit, &line, &mut search.answer, took).await?;
                    }
                }
                (_, Some(_)) => {}
                (_, None) => {
                    self.fail(format_args!("the line is not open any more: see show ports")).await?;
                    return Ok(false);
                }
            }
        }
        match self.heard(plan.port, &STRANGE).wrapping_sub(strange) {
            0 => {}
            strange => {
                let what = "things heard that cannot be read: another speed or format, or noise";
                self.out.line(format_args!("{:12} {strange} {what}", line.speed())).await?;
            }
        }
        Ok(true)
    }

    /// Shows a unit that has been found, with what it says of itself.
    async fn tell_unit(
        &mut self,
        turn: &Turn<'_, '_>,
        unit: u8,
        line: &LineSettings,
        answer: &mut Pdu,
        took: Duration,
    ) -> Result<(), IO::Error> {
        let (speed, took, how) = (line.speed(), Time(took), Answered(answer));
        self.out.text_only(format_args!("unit {unit:>3} {speed:12} {took} {how}")).await?;
        for question in [&IDENTIFY[..], &[REPORT_SERVER_ID]] {
            let asked = turn.ask(unit, question, answer).await;
            // An exception has another function code.
            if asked.is_ok() && answer.first() == question.first() {
                self.out.text_only(format_args!("{}", Identity(answer))).await?;
                break;
            }
        }
        self.out.line(format_args!("")).await?;
        self.out.flush().await
    }

    /// How often `events` were counted at `port`, all together.
    pub(super) fn heard(&self, port: PortId, events: &[Event]) -> u32 {
        let place = self.gateway.ports().get(port.index());
        place.map_or(0, |place| events.iter().fold(0, |sum, event| sum.wrapping_add(place.stats.get(*event))))
    }
}

/// The function that was answered, and with which exception if it was one.
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

/// The units that were found at one speed and format.
struct UnitList<'s> {
    search: &'s Search,
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
