//! The plan of a scan: its words, the speeds and formats in order, and the total time.

use embassy_time::Duration;
use heapless::Vec;

use crate::console::probe::{harmless, serial_client};
use crate::language::{Words, Wrong, number, parse_number, parse_units, time};
use crate::modbus::pdu::function::{DIAGNOSTICS, READ_HOLDING_REGISTERS, REPORT_SERVER_ID};
use crate::settings::{Framing, LineSettings, Parity, PortId, Settings, UnitRange};

/// Default speeds, the likely ones first, behind the port's own speed and format.
const BAUDS: [u32; 8] = [9_600, 19_200, 38_400, 115_200, 57_600, 4_800, 2_400, 1_200];
/// RTU formats, the likely ones first; two stop bits after one, because a receiver for one accepts two.
const RTU_FORMATS: [Format; 4] =
    [(8, Parity::Even, 1), (8, Parity::None, 1), (8, Parity::Odd, 1), (8, Parity::None, 2)];
const ASCII_FORMATS: [Format; 4] =
    [(7, Parity::Even, 1), (7, Parity::None, 2), (7, Parity::Odd, 1), (8, Parity::None, 1)];
/// Data bits, parity, stop bits.
type Format = (u8, Parity, u8);

/// Default time-out to the first character, besides some character times.
const PATIENCE: Duration = Duration::from_millis(60);
const PATIENCE_CHARS: usize = 6;
/// Time-out after a late response was heard, and listening time after the last unit.
pub(super) const SLOW: Duration = Duration::from_millis(500);
/// Limits of a time-out given by the user.
const TIMEOUT: core::ops::RangeInclusive<Duration> = Duration::from_millis(1)..=Duration::from_secs(10);
const EXPECTED: &str = "a baud rate, units, timeout or function";

/// What a scan tries.
pub(super) struct Plan {
    pub(super) port: PortId,
    pub(super) units: UnitRange,
    pub(super) framing: Framing,
    pub(super) own: LineSettings,
    /// Without speeds in the line the port's own speed and format come first.
    own_first: bool,
    bauds: Vec<u32, { BAUDS.len() }>,
    timeout: Option<Duration>,
    pub(super) function: u8,
}

impl Plan {
    /// Parses `P1 9600 19200 units 1-32 timeout 100ms function 4`.
    pub(super) fn parse(settings: &Settings, words: &Words) -> Result<Self, Wrong> {
        let (port, serial) = serial_client(settings, words.take())?;
        let mut plan = Self {
            port,
            units: UnitRange { first: 1, last: 247 },
            framing: serial.framing,
            own: serial.line,
            own_first: false,
            bauds: Vec::new(),
            timeout: None,
            function: READ_HOLDING_REGISTERS,
        };
        while !words.peek().is_end() {
            let word = words.take();
            if parse_number(word.text).is_some() {
                let baud = number(word, "a baud rate", 1..=10_000_000)?;
                plan.bauds.push(baud).map_err(|_| word.expected("at most 8 baud rates"))?;
            } else if word.is("units") {
                plan.units = parse_units(words.take())?;
                // Unit 0 is the broadcast, without a response.
                plan.units.first = plan.units.first.max(1);
            } else if word.is("timeout") {
                plan.timeout = Some(time(words.take(), &TIMEOUT)?);
            } else if word.is("function") {
                let word = words.take();
                let function = parse_number(word.text).and_then(|number| u8::try_from(number).ok());
                let changes_nothing =
                    |function: &u8| matches!(function, 1..=4 | &DIAGNOSTICS | &REPORT_SERVER_ID);
                plan.function = function
                    .filter(changes_nothing)
                    .ok_or_else(|| word.expected("a function that changes nothing: 1 to 4, 8 or 17"))?;
            } else {
                return Err(word.expected(EXPECTED));
            }
        }
        if plan.bauds.is_empty() {
            plan.own_first = true;
            plan.bauds.extend(BAUDS);
        }
        Ok(plan)
    }

    /// The number of speeds and formats.
    pub(super) fn lines_count(&self) -> usize {
        usize::from(self.own_first) + self.bauds.len() * RTU_FORMATS.len()
    }

    /// Whether the line at index `nth` was the first one already.
    pub(super) fn is_again(&self, nth: usize) -> bool {
        self.own_first && nth > 0 && self.line(nth).is_some_and(|line| self.is_own(&line))
    }

    /// Whether `line` has the port's own speed and format.
    pub(super) fn is_own(&self, line: &LineSettings) -> bool {
        LineSettings { gap: None, ..*line } == LineSettings { gap: None, ..self.own }
    }

    /// The line's settings at index `nth`.
    pub(super) fn line(&self, nth: usize) -> Option<LineSettings> {
        let Some(nth) = nth.checked_sub(self.own_first.into()) else { return Some(self.own) };
        let formats = if self.framing == Framing::Rtu { &RTU_FORMATS } else { &ASCII_FORMATS };
        let baud = *self.bauds.get(nth / formats.len())?;
        let (data_bits, parity, stop_bits) = *formats.get(nth % formats.len())?;
        let line = LineSettings { baud, data_bits, parity, stop_bits, gap: None, ..self.own };
        // The port's gap may be meant for another speed; none below the specification's is used.
        Some(LineSettings { gap: self.own.gap.filter(|gap| *gap > line.t3_5()), ..line })
    }

    /// The time-out to the first character of a response.
    pub(super) fn patience(&self, line: &LineSettings) -> Duration {
        self.timeout.unwrap_or_else(|| PATIENCE + line.gap() + line.chars(PATIENCE_CHARS))
    }

    /// Listening time for late responses after the last unit.
    pub(super) fn rest(&self, line: &LineSettings) -> Duration {
        SLOW.checked_sub(self.patience(line)).unwrap_or(Duration::from_ticks(0))
    }

    /// Units that may be asked before a slow response arrives.
    pub(super) fn slow_units(&self, line: &LineSettings) -> usize {
        (SLOW.as_ticks() / self.patience(line).as_ticks().max(1)) as usize + 1
    }

    /// The time from line `nth` on, if no unit responds.
    pub(super) fn time_from(&self, nth: usize) -> Duration {
        let units = u32::from(self.units.last.saturating_sub(self.units.first)) + 1;
        let request = self.framing.chars_of(harmless(self.function).len());
        let mut sum = Duration::from_ticks(0);
        for (nth, line) in (nth..).map_while(|nth| Some((nth, self.line(nth)?))) {
            if self.is_again(nth) {
                continue;
            }
            sum += (line.chars(request) + self.patience(&line) + line.gap()) * units + self.rest(&line);
        }
        sum
    }
}
