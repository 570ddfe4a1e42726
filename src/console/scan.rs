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
use super::rows::{port_name, text};
use crate::asking::Turn;
use crate::config::{LineSettings, Name, Port, PortId, Settings, Side, Time, Words};
use crate::hal::{Store, System};
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
}

impl<IO: Read + Write, S: Store, Y: System> Session<'_, '_, IO, S, Y> {
    /// Looks for units as the words say.
    pub(super) async fn scan(&mut self, words: &mut Words<'_>) -> Result<(), IO::Error> {
        let plan = match self.gateway.settings(|settings| Plan::parse(settings, words)) {
            Ok(plan) => plan,
            Err(error) => return self.fail(format_args!("{error}")).await,
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
        let mut search = Search { at: [0; 256], begun: Instant::now(), watch: Watch::new() };
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
        self.found(&plan, &search).await
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
            return Ok(true);
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
            let asked = self.unless_typed(&mut search.watch, turn.ask(unit, &request(plan.function))).await?;
            let Some(answer) = asked else { return Ok(false) };
            match (answer, turn.outcome()) {
                (Ok((answer, _)), Some(Ok(took))) => {
                    // With a faulty character it was sent in another format, whatever its CRC says.
                    if self.heard(plan.port, &[Event::Parity, Event::Framing]) == flaws {
                        search.at.iter_mut().skip(unit.into()).take(1).for_each(|at| *at = nth as u8 + 1);
                        let took = to_first_char(took, plan.framing, &line, answer.len());
                        self.tell_unit(turn, unit, &line, &answer, took).await?;
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
        answer: &Pdu,
        took: Duration,
    ) -> Result<(), IO::Error> {
        let (speed, took) = (line.speed(), Time(took));
        match **answer {
            [function, code] if function & EXCEPTION_BIT != 0 => {
                let (function, exception) = (function & !EXCEPTION_BIT, Exception(code));
                self.out
                    .text_only(format_args!(
                        "unit {unit:>3} {speed:12} {took} function {function}: {exception}"
                    ))
                    .await?;
            }
            _ => {
                let function = answer.first().copied().unwrap_or(0);
                self.out
                    .text_only(format_args!("unit {unit:>3} {speed:12} {took} function {function}"))
                    .await?;
            }
        }
        let mut said = turn.ask(unit, &IDENTIFY).await;
        if !said.as_ref().is_ok_and(|(pdu, _)| pdu.first() == Some(&ENCAPSULATED_INTERFACE)) {
            said = turn.ask(unit, &[REPORT_SERVER_ID]).await;
        }
        let said = said.map(|(pdu, _)| pdu).unwrap_or_default();
        self.out.line(format_args!("{}", Identity(&said))).await?;
        self.out.flush().await
    }

    /// Shows what has been found in all, and the lines to type for it.
    async fn found(&mut self, plan: &Plan, search: &Search) -> Result<(), IO::Error> {
        let units = search.at.iter().filter(|at| **at > 0).count();
        let took = search.begun.elapsed().as_secs();
        self.out.line(format_args!("{units} units found in {took}s")).await?;
        let name = self.gateway.settings(|settings| port_name(settings, plan.port));
        for (nth, line) in plan.lines().enumerate() {
            let at = nth as u8 + 1;
            if search.at.contains(&at) {
                let units = UnitList { search, at };
                self.out.line(format_args!("edit port {name} {:12} # units {units}", line.speed())).await?;
            }
        }
        let first = search.at.iter().position(|at| *at > 0);
        let last = search.at.iter().rposition(|at| *at > 0);
        if let (Some(first), Some(last)) = (first, last)
            && let Some(source) = self.gateway.settings(|settings| source_for(settings, plan.port))
        {
            self.out.line(format_args!("route {source} {first}-{last} * * {name}")).await?;
        }
        Ok(())
    }

    /// How often `events` were counted at `port`, all together.
    pub(super) fn heard(&self, port: PortId, events: &[Event]) -> u32 {
        let place = self.gateway.ports().get(port.index());
        place.map_or(0, |place| events.iter().fold(0, |sum, event| sum.wrapping_add(place.stats.get(*event))))
    }
}

/// The source of the rule that leads to `port`, if there is no such rule yet.
fn source_for(settings: &Settings, port: PortId) -> Option<Name> {
    let is_server = |port: &&Port| port.kind.side() == Side::Server && !port.kind.asks_by_itself();
    let is_routed = settings.routes.iter().any(|route| route.destination == Destination::Port(port));
    let server = settings.ports.iter().flatten().find(is_server);
    (!is_routed).then(|| text(format_args!("{}", server.map_or("SOURCE", |port| port.name.as_str()))))
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
