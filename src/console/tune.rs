//! `tune`: measures the response times of a line's units, and proposes a time-out and a gap.
//!
//! Each unit gets the same request repeatedly, with a long time-out. Other traffic of the port continues. A unit that misses requests
//! is asked with growing gaps, from the specification's on; the first gap without a miss is proposed. However it ends, the port
//! returns to its own settings.

use embassy_time::{Duration, Instant};

use super::probe::{About, Told, harmless, serial_client, to_first_char};
use super::rows::{port_name, took};
use super::session::Session;
use super::wait::{Begun, Wait, WaitEvent};
use crate::gateway::direct_request::Turn;
use crate::gateway::unit_health::Units;
use crate::language::{Words, Wrong, number, parse_units};
use crate::modbus::pdu::function::{DIAGNOSTICS, READ_HOLDING_REGISTERS, READ_INPUT_REGISTERS};
use crate::settings::{Framing, LineSettings, PortId, SerialClientSettings, Settings, Time, UnitRange};
use crate::stats::response_tail::ResponseTail;

/// Default number of requests per unit: one standard deviation of the result is at most 8 %.
const COUNT: u32 = 2_000;
/// Minimum time-out of a request.
const PATIENCE: Duration = Duration::from_secs(3);
/// Misses before a unit is given up.
const LOST_MAX: u32 = 20;
/// Requests to judge a gap, misses allowed for noise, and the longest gap.
const GAP_REQUESTS: u32 = 50;
const GAP_LOST_MAX: u32 = 2;
const GAP_LONGEST: Duration = Duration::from_millis(100);
/// Functions to try until one gets a response, and the attempts for each.
const FUNCTIONS: [u8; 3] = [READ_HOLDING_REGISTERS, DIAGNOSTICS, READ_INPUT_REGISTERS];
const TRIES: u32 = 2;

/// A running measurement.
pub(super) struct Tune {
    port: PortId,
    framing: Framing,
    line: LineSettings,
    client: SerialClientSettings,
    /// The units known at the port, unless named.
    units: Option<UnitRange>,
    count: u32,
    told: Told,
    /// The time-out for the slowest unit.
    p999_us: u32,
    /// The gap that a unit needs, if longer than the port's.
    longest_gap: Option<Duration>,
    /// The current unit, gap, and function if known.
    unit: u8,
    gap: Duration,
    function: Option<u8>,
    /// The current stage.
    stage: Stage,
    series: Series,
}

/// The stage of a unit's measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Starts the next unit.
    Unit,
    /// Waits for the line to open with a gap.
    Opening,
    /// Tries this one of the functions.
    Function(usize),
    /// Tests the gap.
    Gap,
    /// Measures the response time.
    Times,
}

/// A series of requests to a unit.
struct Series {
    begun: Instant,
    asked: u32,
    /// Number of requests, and of misses allowed.
    count: u32,
    lost_max: u32,
    lost: u32,
    /// Response times.
    sum: Duration,
    tail: ResponseTail,
}

impl Series {
    fn new(count: u32, lost_max: u32) -> Self {
        let (sum, tail) = (Duration::from_ticks(0), ResponseTail::new());
        Self { begun: Instant::now(), asked: 0, count, lost_max, lost: 0, sum, tail }
    }

    fn is_over(&self) -> bool {
        self.lost > self.lost_max || self.asked >= self.count
    }
}

impl Session<'_, '_> {
    /// Starts a measurement.
    pub(super) fn tune(&mut self, words: &Words<'_>) -> Begun<Tune> {
        let tune = self.gateway.settings(|settings| Tune::parse(settings, words))?;
        if let Err(error) = self.take_turn(tune.port) {
            return Ok((None, self.fail(&error)));
        }
        Ok((Some(tune), Wait::Sent))
    }
}

impl Tune {
    /// Parses `P1 units 1-5 count 1000`.
    fn parse(settings: &Settings, words: &Words) -> Result<Self, Wrong> {
        let (port, serial) = serial_client(settings, words.take())?;
        let mut units = None;
        let mut count = COUNT;
        while !words.peek().is_end() {
            let word = words.take();
            if word.is("units") || word.is("unit") {
                let range = parse_units(words.take())?;
                // Unit 0 is the broadcast, without a response.
                units = Some(UnitRange { first: range.first.max(1), ..range });
            } else if word.is("count") {
                count = number(words.take(), "requests", 10..=20_000)?;
            } else {
                return Err(word.expected("units or count"));
            }
        }
        Ok(Self {
            port,
            framing: serial.framing,
            line: serial.line,
            client: serial.client,
            units,
            count,
            told: Told::new(),
            p999_us: 0,
            longest_gap: None,
            unit: 0,
            gap: Duration::from_ticks(0),
            function: None,
            stage: Stage::Unit,
            series: Series::new(0, 0),
        })
    }

    /// Runs the next step after `event`.
    pub(super) fn step(&mut self, session: &mut Session<'_, '_>, event: WaitEvent) -> Wait {
        match (self.stage, event) {
            (_, WaitEvent::Typed(_)) => {
                session.out.line(format_args!("stopped: too little is known to propose anything"));
                Wait::End
            }
            (Stage::Unit, _) => self.next_unit(session),
            (Stage::Opening, WaitEvent::Opened(Err(error))) => session.fail(&error),
            (Stage::Opening, _) => {
                match self.function {
                    Some(_) => self.begin(Stage::Gap, GAP_REQUESTS, GAP_LOST_MAX),
                    None => self.begin(Stage::Function(0), TRIES, TRIES),
                }
                self.ask(session)
            }
            (_, WaitEvent::Response(asked)) => {
                self.note(session, asked.is_ok());
                if self.series.is_over() { self.judge(session) } else { self.ask(session) }
            }
            _ => self.ask(session),
        }
    }

    /// Starts the next unit, or ends.
    fn next_unit(&mut self, session: &mut Session<'_, '_>) -> Wait {
        let state = session.gateway.port_state(self.port);
        let is_known = |id| {
            let answered =
                |units: &mut Units| units.iter().any(|known| known.id == id && known.responses > 0);
            self.units.is_some() || state.is_some_and(|state| state.units(answered))
        };
        let UnitRange { first, last } = self.units.unwrap_or(UnitRange { first: 1, last: 255 });
        let next = (first..=last).find(|id| *id > self.unit && is_known(*id));
        match next {
            Some(next) => {
                self.unit = next;
                self.gap = self.least_gap();
                self.function = None;
                self.open()
            }
            None if self.unit == 0 => {
                session.fail(&"no unit has answered at this port yet: name some, units 1-5")
            }
            None => self.propose(session),
        }
    }

    /// The longest gap needed so far.
    fn least_gap(&self) -> Duration {
        self.longest_gap.unwrap_or(self.line.gap().max(self.line.t3_5()))
    }

    /// Reopens the line with the current gap.
    fn open(&mut self) -> Wait {
        self.stage = Stage::Opening;
        let line = LineSettings { gap: Some(self.gap), ..self.line };
        Wait::Open { line, timeout: self.client.timeout.max(PATIENCE), alone: false }
    }

    fn begin(&mut self, stage: Stage, count: u32, lost_max: u32) {
        self.stage = stage;
        self.series = Series::new(count, lost_max);
    }

    /// Asks the unit once.
    fn ask(&mut self, session: &mut Session<'_, '_>) -> Wait {
        let Series { begun, asked, count, .. } = self.series;
        if self.told.is_due() {
            let left = About(begun.elapsed() * (count - asked) / asked.max(1));
            session.out.line(format_args!("unit {}: {asked} of {count}, about {left} left", self.unit));
        }
        let function = match self.stage {
            Stage::Function(nth) => FUNCTIONS.get(nth).copied(),
            _ => self.function,
        };
        session.ask_unit(self.unit, harmless(function.unwrap_or(READ_HOLDING_REGISTERS)), true)
    }

    /// Records a response time or a miss.
    fn note(&mut self, session: &Session<'_, '_>, answered: bool) {
        self.series.asked += 1;
        match session.turn.as_ref().and_then(Turn::outcome) {
            Some(Ok(took)) if answered => {
                let first = to_first_char(took, self.framing, &self.line, session.pdu.len());
                self.series.sum += first;
                self.series.tail.add(u32::try_from(first.as_micros()).unwrap_or(u32::MAX));
            }
            _ => self.series.lost += 1,
        }
    }

    /// Continues after a series.
    fn judge(&mut self, session: &mut Session<'_, '_>) -> Wait {
        let Series { lost, sum, ref tail, .. } = self.series;
        let (unit, count) = (self.unit, tail.count());
        match self.stage {
            Stage::Function(nth) if count > 0 => {
                self.function = FUNCTIONS.get(nth).copied();
                self.begin(Stage::Gap, GAP_REQUESTS, GAP_LOST_MAX);
                return self.ask(session);
            }
            Stage::Function(nth) if nth + 1 < FUNCTIONS.len() => {
                self.begin(Stage::Function(nth + 1), TRIES, TRIES);
                return self.ask(session);
            }
            Stage::Function(_) => session.out.line(format_args!("unit {unit}: no response")),
            Stage::Gap if lost <= GAP_LOST_MAX => {
                self.begin(Stage::Times, self.count, LOST_MAX);
                return self.ask(session);
            }
            Stage::Gap if self.gap * 2 <= GAP_LONGEST => {
                self.gap *= 2;
                return self.open();
            }
            Stage::Gap => {
                session.out.line(format_args!("unit {unit}: no gap helps: see its errors in show units"))
            }
            _ => {
                let (mean, p999) = (Time(sum / count.max(1)), took(tail.p999()));
                let function = self.function.unwrap_or(READ_HOLDING_REGISTERS);
                session.out.line(format_args!(
                    "unit {unit}: {count} responses by function {function}, {lost} lost; {mean} on the average, 999 of 1000 within {p999}"
                ));
                self.p999_us = self.p999_us.max(tail.p999().unwrap_or(0));
                if self.gap > self.least_gap() {
                    self.longest_gap = Some(self.gap);
                }
            }
        }
        self.stage = Stage::Unit;
        Wait::Sent
    }

    /// Shows the proposed line.
    fn propose(&self, session: &mut Session<'_, '_>) -> Wait {
        if self.p999_us == 0 {
            return Wait::End;
        }
        let timeout = rounded_up(self.p999_us);
        let name = port_name(session.gateway, self.port);
        let out = &mut session.out;
        out.put(format_args!("edit port {name} timeout {}", Time(timeout)));
        if let Some(gap) = self.longest_gap {
            out.put(format_args!(" gap {}", Time(gap)));
        }
        // After a broadcast a unit is busy as long as before a response (Serial Line 2.4.1).
        if timeout > self.client.turnaround {
            out.put(format_args!(" turnaround {}", Time(timeout)));
        }
        out.end();
        Wait::End
    }
}

/// Rounds a time-out: to tenths of a millisecond, above 10 ms to whole ones.
fn rounded_up(us: u32) -> Duration {
    let step = if us < 10_000 { 100 } else { 1_000 };
    Duration::from_micros(u64::from(us.next_multiple_of(step).max(1_000)))
}
