//! Shared by `scan` and `tune`: the serial client's line, a harmless request, the start of a response, and progress reports.

use core::fmt;

use embassy_time::{Duration, Instant};

use crate::language::{Problem, Word, Wrong};
use crate::modbus::pdu::function::{
    DIAGNOSTICS, READ_COILS, READ_DISCRETE_INPUTS, READ_HOLDING_REGISTERS, READ_INPUT_REGISTERS,
    REPORT_SERVER_ID,
};
use crate::settings::{Framing, LineSettings, PortId, PortKind, SerialSettings, Settings, Side};

/// Interval of progress reports; writing them also detects a closed session.
const PROGRESS: Duration = Duration::from_secs(5);

/// Parses a port, which must be a serial client.
pub(super) fn serial_client<'s>(
    settings: &'s Settings,
    word: Word<'_>,
) -> Result<(PortId, &'s SerialSettings), Wrong> {
    let port = settings.find(word.text).ok_or_else(|| word.error(Problem::NoSuchPort))?;
    match settings.port(port).map(|port| &port.kind) {
        Some(PortKind::Serial(serial)) if serial.side == Side::Client => Ok((port, serial)),
        _ => Err(word.expected("a port that is the client of a serial line")),
    }
}

/// A request of `function` that changes nothing: reads the first cell, or an echo (8), or the server id (17).
pub(super) fn harmless(function: u8) -> &'static [u8] {
    match function {
        READ_COILS => &[READ_COILS, 0, 0, 0, 1],
        READ_DISCRETE_INPUTS => &[READ_DISCRETE_INPUTS, 0, 0, 0, 1],
        READ_INPUT_REGISTERS => &[READ_INPUT_REGISTERS, 0, 0, 0, 1],
        DIAGNOSTICS => &[DIAGNOSTICS, 0, 0, 0xa5, 0x37],
        REPORT_SERVER_ID => &[REPORT_SERVER_ID],
        _ => &[READ_HOLDING_REGISTERS, 0, 0, 0, 1],
    }
}

/// The time to the first character of a response, given the time to its end: time-outs count to the first character.
pub(super) fn to_first_char(
    took: Duration,
    framing: Framing,
    line: &LineSettings,
    pdu_bytes: usize,
) -> Duration {
    let behind = line.chars(framing.chars_of(pdu_bytes) - 1);
    took.checked_sub(behind).unwrap_or(Duration::from_ticks(0))
}

/// The time of the last progress report.
pub(super) struct Told(Instant);

impl Told {
    pub(super) fn new() -> Self {
        Self(Instant::now())
    }

    /// Whether a progress report is due.
    pub(super) fn is_due(&mut self) -> bool {
        let due = self.0.elapsed() >= PROGRESS;
        if due {
            *self = Self::new();
        }
        due
    }
}

/// A rounded time.
pub(super) struct About(pub(super) Duration);

impl fmt::Display for About {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.as_secs() + 1 {
            seconds @ ..120 => write!(f, "{seconds}s"),
            seconds => write!(f, "{}m", seconds / 60),
        }
    }
}
