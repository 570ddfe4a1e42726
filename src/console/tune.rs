//! `tune`: how long the units of a serial line take to answer, and the time-out and the gap that follow from it.
//!
//! Each unit is asked the same again and again, with a long time-out. The port's other traffic goes on meanwhile. A unit that
//! does not answer everything is asked after longer and longer silences, beginning with the legal one; the first at which it
//! does is proposed. Whatever ends it, the port has its own settings again.

use embassy_time::{Duration, Instant};
use embedded_io_async::{Read, Write};

use super::command::Session;
use super::probe::{About, Watch, request, serial_client, to_first_char};
use super::rows::{port_name, took};
use crate::asking::Turn;
use crate::config::{
    Framing, LineSettings, PortId, SerialClientSettings, Settings, Time, Words, Wrong, number, parse_units,
};
use crate::hal::{Store, System};
use crate::modbus::pdu::function::{DIAGNOSTICS, READ_HOLDING_REGISTERS, READ_INPUT_REGISTERS};
use crate::port::answer_tail::AnswerTail;
use crate::port::units::Units;
use crate::route::UnitRange;
use crate::scanner::Pdu;

/// Requests to each unit unless the words say another number: one standard deviation of what is told is at most 8 %.
const COUNT: u32 = 2_000;
/// A unit has so long for an answer, or as long as the port gives it if that is more.
const PATIENCE: Duration = Duration::from_secs(3);
/// Requests that may get no answer before a unit is given up.
const LOST_MAX: u32 = 20;
/// Requests by which a gap is judged, how many of them the noise of a line may cost, and the longest gap.
const GAP_REQUESTS: u32 = 50;
const GAP_LOST_MAX: u32 = 2;
const GAP_LONGEST: Duration = Duration::from_millis(100);
/// Functions that are tried, so often each, until one is answered.
const FUNCTIONS: [u8; 3] = [READ_HOLDING_REGISTERS, DIAGNOSTICS, READ_INPUT_REGISTERS];
const TRIES: u32 = 2;

/// What is measured, and what has come of it.
struct Course {
    port: PortId,
    framing: Framing,
    line: LineSettings,
    client: SerialClientSettings,
    /// Those that are known at the port unless some are named.
    units: Option<UnitRange>,
    count: u32,
    watch: Watch,
    /// What the slowest unit needs.
    p999_us: u32,
    /// The silence that a unit needs, if it is more than the port's.
    gap: Option<Duration>,
}

/// What was measured of a unit.
struct Measured {
    /// Of all answers.
    sum: Duration,
    tail: AnswerTail,
    lost: u32,
}

impl Course {
    /// Reads `P1 units 1-5 count 1000`.
    fn parse(settings: &Settings, words: &Words) -> Result<Self, Wrong> {
        let (port, serial) = serial_client(settings, words.take())?;
        let mut units = None;
        let mut count = COUNT;
        while !words.peek().is_end() {
            let word = words.take();
            if word.is("units") || word.is("unit") {
                let range = parse_units(words.take())?;
                // To unit 0 nobody answers.
                units = Some(UnitRange { first: range.first.max(1), ..range });
            } else if word.is("count") {
                count = number(words.take(), "requests", 10..=20_000)?;
            } else {
                return Err(word.expected("units or count"));
            }
        }
        let (framing, line, client) = (serial.framing, serial.line, serial.client);
        let watch = Watch::new();
        Ok(Self { port, framing, line, client, units, count, watch, p999_us: 0, gap: None })
    }

    /// The first unit above `unit` that is to be measured.
    fn next(&self, unit: u8, is_known: impl Fn(u8) -> bool) -> Option<u8> {
        let range = self.units.unwrap_or(UnitRange { first: 1, last: 255 });
        (range.first..=range.last).find(|next| *next > unit && (self.units.is_some() || is_known(*next)))
    }

    fn patience(&self) -> Duration {
        self.client.timeout.max(PATIENCE)
    }
}

impl<IO: Read + Write, S: Store, Y: System> Session<'_, '_, IO, S, Y> {
    /// Measures what the words say, and shows the line to type.
    pub(super) async fn tune(&mut self, words: &Words<'_>) -> Result<(), IO::Error> {
        let mut course = match self.gateway.settings(|settings| Course::parse(settings, words)) {
            Ok(course) => course,
            Err(Wrong) => return self.fail(format_args!("{}", words.wrong())).await,
        };
        let gateway = self.gateway;
        let turn = match gateway.turn(course.port) {
            Ok(turn) => turn,
            Err(error) => return self.fail(format_args!("{error}")).await,
        };
        let place = gateway.place(course.port);
        let is_known = |unit| {
            let answered =
                |units: &mut Units| units.iter().any(|known| known.id == unit && known.answers > 0);
            place.is_some_and(|place| place.units(answered))
        };
        let mut unit = 0;
        while let Some(next) = course.next(unit, is_known) {
            unit = next;
            if self.tune_unit(&mut course, &turn, unit).await?.is_none() {
                break;
            }
        }
        drop(turn);
        if unit == 0 {
            return self
                .fail(format_args!("no unit has answered at this port yet: name some, units 1-5"))
                .await;
        }
        self.propose(&course).await
    }

    /// Measures one unit; `None` when all shall end.
    async fn tune_unit(
        &mut self,
        course: &mut Course,
        turn: &Turn<'_, '_>,
        unit: u8,
    ) -> Result<Option<()>, IO::Error> {
        let own = course.gap.unwrap_or(course.line.gap().max(course.line.t3_5()));
        let mut gap = own;
        let mut function = None;
        // The first gap that is long enough, or else the port's own.
        loop {
            let line = LineSettings { gap: Some(gap), ..course.line };
            if let Err(error) = turn.try_on(line, course.patience(), false).await {
                self.fail(format_args!("{error}")).await?;
                return Ok(None);
            }
            if function.is_none() {
                for tried in FUNCTIONS {
                    let Some(some) = self.measure(course, turn, (unit, tried), TRIES, TRIES).await? else {
                        return Ok(None);
                    };
                    function = (some.tail.count() > 0).then_some(tried);
                    if function.is_some() {
                        break;
                    }
                }
            }
            let Some(function) = function else {
                self.out.line(format_args!("unit {unit}: no answer")).await?;
                return Ok(Some(()));
            };
            let some = self.measure(course, turn, (unit, function), GAP_REQUESTS, GAP_LOST_MAX).await?;
            let Some(some) = some else { return Ok(None) };
            if some.lost <= GAP_LOST_MAX {
                break;
            }
            gap *= 2;
            if gap > GAP_LONGEST {
                self.out
                    .line(format_args!("unit {unit}: no gap helps: see its troubles in show units"))
                    .await?;
                return Ok(Some(()));
            }
        }
        let function = function.unwrap_or(READ_HOLDING_REGISTERS);
        let measured = self.measure(course, turn, (unit, function), course.count, LOST_MAX).await?;
        let Some(Measured { sum, tail, lost }) = measured else { return Ok(None) };
        let count = tail.count();
        let (mean, p999) = (Time(sum / count.max(1)), took(tail.p999()));
        self.out
            .line(format_args!(
                "unit {unit}: {count} answers by function {function}, {lost} lost; {mean} on the average, 999 of 1000 within {p999}"
            ))
            .await?;
        course.p999_us = course.p999_us.max(tail.p999().unwrap_or(0));
        if gap > own {
            course.gap = Some(gap);
        }
        Ok(Some(()))
    }

    /// Asks a unit `count` times, or until more than `lost_max` got no answer; `None` when something is typed.
    async fn measure(
        &mut self,
        course: &mut Course,
        turn: &Turn<'_, '_>,
        (unit, function): (u8, u8),
        count: u32,
        lost_max: u32,
    ) -> Result<Option<Measured>, IO::Error> {
        let mut measured = Measured { sum: Duration::from_ticks(0), tail: AnswerTail::new(), lost: 0 };
        let (request, begun) = (request(function), Instant::now());
        let mut answer = Pdu::new();
        for nth in 0..count {
            if course.watch.is_due() {
                let left = About(begun.elapsed() * (count - nth) / nth.max(1));
                self.out.line(format_args!("unit {unit}: {nth} of {count}, about {left} left")).await?;
                self.out.flush().await?;
            }
            let ask = turn.ask(unit, &request, &mut answer);
            let Some(asked) = self.unless_typed(&mut course.watch, ask).await? else { return Ok(None) };
            if let (Ok(_), Some(Ok(took))) = (asked, turn.outcome()) {
                let first = to_first_char(took, course.framing, &course.line, answer.len());
                measured.sum += first;
                measured.tail.add(u32::try_from(first.as_micros()).unwrap_or(u32::MAX));
                continue;
            }
            measured.lost += 1;
            if measured.lost > lost_max {
                break;
            }
        }
        Ok(Some(measured))
    }

    /// Shows the line to type.
    async fn propose(&mut self, course: &Course) -> Result<(), IO::Error> {
        if course.p999_us == 0 {
            return Ok(());
        }
        let timeout = rounded_up(course.p999_us);
        let name = port_name(self.gateway, course.port);
        self.out.text_only(format_args!("edit port {name} timeout {}", Time(timeout))).await?;
        if let Some(gap) = course.gap {
            self.out.text_only(format_args!(" gap {}", Time(gap))).await?;
        }
        // Behind a broadcast a unit is as busy as before an answer (Serial Line 2.4.1).
        if timeout > course.client.turnaround {
            self.out.text_only(format_args!(" turnaround {}", Time(timeout))).await?;
        }
        self.out.line(format_args!("")).await
    }
}

/// A time-out as people write it: in tenths of a millisecond, above ten in whole ones.
fn rounded_up(us: u32) -> Duration {
    let step = if us < 10_000 { 100 } else { 1_000 };
    Duration::from_micros(u64::from(us.next_multiple_of(step).max(1_000)))
}
